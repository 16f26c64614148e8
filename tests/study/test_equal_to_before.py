"""Sessions of every shipped study and task come out as before trials became scripts.

`oracles/before_scripts.json` was written by the last revision that had none (with the methods that
studies name today, where templates have changed since). Equal are journals,
files of flips and files of gaze, but for what names the program and for fields that were added.
"""

import hashlib
import json
from pathlib import Path

import pytest
from attack.kills import CASES, RESTLESS, write_study

from protocols.disk.hashing import canonical_json
from protocols.journal_file import read_journal
from protocols.load import load_study
from study_app.gaze.simulated import HUMAN
from study_app.simulate import SimulatedStudy, simulate_session

BEFORE = json.loads(Path(__file__).with_name("oracles").joinpath("before_scripts.json").read_text())
PROGRAM = ("chain", "revision", "versions", "platform")
ADDED = ("further",)
"""Fields that came later: left out where they say nothing."""
HASHES = ("protocol_sha256", "stimuli_sha256", "manifest_sha256", "plan_sha256")
FAULTS = {"missed_per_flip": 0.004, "late_per_flip": 0.004, "doubled_per_flip": 0.004}
SHORT = ("demo", "showcase", "inpainting-2afc")
LONG = tuple(name for name in BEFORE if name not in (*SHORT, *CASES))


def simulated(name: str, folder: Path) -> dict[str, object]:
    """Return how many decisions a session has, and the hashes of what it left behind."""
    if name in CASES:  # studies of the templates, which may gain keys
        short = write_study(folder, CASES[name])
        study, display, model, ignored = short.study, short.display, short.model, HASHES
    else:
        study, display = load_study(Path(name))
        study = study.model_copy(update={"web": None})  # three studies gained it
        study, model, ignored = study.in_any_order(), None, ()
    gaze = RESTLESS if name in CASES else HUMAN
    simulation = SimulatedStudy(
        study, display, seed=7, model=model, gaze=gaze, gaze_rate_hz=60.0, **FAULTS
    )
    simulate_session(simulation, folder / "sessions", "S001")
    journal = read_journal(next(folder.rglob("journal.jsonl")))
    lines, files = [], {"flips": [], "gaze": []}
    for event in journal.events:
        plain = event.model_dump(mode="json")
        for key in (*PROGRAM, *ignored, *(key for key in ADDED if not plain.get(key))):
            plain.pop(key, None)
        if event.kind == "session-start":  # before, every session called its task so
            assert plain["task"] == study.task.kind
            plain["task"] = "two-interval"
        if event.kind == "attempt":
            for kind, side in (("flips", event.flips_file), ("gaze", event.gaze_file)):
                files[kind] += [(journal.path.parent / side.file).read_bytes()] if side else []
        lines.append(canonical_json(plain))
    return {
        "decisions": sum(a.outcome == "completed" for a in journal.attempts),
        "void": sum(a.outcome == "void" for a in journal.attempts),
        **{
            kind: hashlib.sha256(b"\n".join(parts)).hexdigest()
            for kind, parts in {"journal": lines, **files}.items()
        },
    }


@pytest.mark.parametrize("name", [*SHORT, *(name for name in CASES if name in BEFORE)])
def test_a_session_leaves_what_it_left_before(tmp_path, name):
    assert simulated(name, tmp_path) == BEFORE[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", LONG)
def test_a_long_session_leaves_what_it_left_before(tmp_path, name):
    assert simulated(name, tmp_path) == BEFORE[name]


def test_enough_was_compared():
    assert sum(found["decisions"] for found in BEFORE.values()) >= 700
    assert sum(found["void"] for found in BEFORE.values()) >= 40
