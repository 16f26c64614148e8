"""Clips that were built by the last revision of format 1, played in the real window.

`format1/` holds a study of one decision, its display, and its clips as revision 7b43e25 built
them; without previews and masks, which nobody plays.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from protocols.hashing import sha256_file
from protocols.upgrade import upgraded_text
from study_app.simulate import Simulation, simulate_sitting
from study_app.strip import compare

DATA = Path(__file__).parent / "format1"
PROTOCOL_SHA256 = "c7cc9bd8cc6b40a209bb1d205587661e53b158c43c1827d087c266ccb13c8afa"
"""As the old code computed it."""


@pytest.fixture
def old_study(start_study):
    """A copy of the old study: its file, its display and its clips."""
    study = start_study()
    shutil.copytree(DATA, study.folder, dirs_exist_ok=True)
    return study


def test_the_stored_files_are_those_of_the_old_manifest():
    """The golden material itself, read without any code of ours that knows its format."""
    manifest = json.loads((DATA / "clips" / "manifest.json").read_text(encoding="utf-8"))

    assert manifest["format"] == 1
    assert len(manifest["clips"]) == 2
    for clip in manifest["clips"]:
        assert not {"name", "condition"} & set(clip)
        folder = DATA / "clips" / f"{clip['scene']}__{clip['size']}__{clip['method']}"
        assert [sha256_file(path) for path in sorted(folder.iterdir())] == clip["frames_sha256"]


def test_another_process_sees_the_old_frames_at_every_logged_flip(screen, old_study):
    seen = screen.watch(old_study)

    logged, names = old_study.logged()
    assert compare(logged, seen, names) == []
    shown = {name for name in logged.values() if name}
    assert shown == {
        f"garden__small__{method}/{index}"
        for method in ("reference", "push-pull")
        for index in range(3)
    }
    journal = old_study.journal()
    assert journal.start.format == 2
    assert journal.start.protocol_sha256 == PROTOCOL_SHA256
    assert journal.start.manifest_sha256 == sha256_file(DATA / "clips" / "manifest.json")
    assert [attempt.outcome for attempt in journal.attempts] == ["completed"]
    assert [stimulus.frames_shown for stimulus in journal.attempts[0].stimuli] == [3, 3]


def test_the_upgraded_study_plays_the_same_files(old_study):
    old_study.path.write_text(upgraded_text(old_study.path), encoding="utf-8")
    assert old_study.protocol.format == 2
    manifest = old_study.manifest
    simulation = Simulation(old_study.protocol, old_study.display, manifest=manifest)

    simulate_sitting(simulation, old_study.sessions, "P01")

    start = old_study.journal().start
    assert start.protocol_sha256 != PROTOCOL_SHA256
    assert start.manifest_sha256 == sha256_file(DATA / "clips" / "manifest.json")
    stored = {sha256_file(path) for path in (DATA / "clips").glob("*/*.png")}
    assert {row["frame_sha256"] for row in old_study.flips()} == stored | {""}
