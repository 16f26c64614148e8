"""A study for browsers with pixels, small enough for a test, and sessions of it by the kernel."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from task_cases import CASES, Case, case_text
from web_kernel import Kernel

from protocols.disk.hashing import sha256_file
from protocols.display import Display
from protocols.feasibility import virtual_manifest
from protocols.load import load_display, load_study
from protocols.manifest import Manifest, write_manifest
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import Web
from study_app.web import export, packs
from study_app.web.export import WebBuild
from study_app.web.import_lines import ImportResult, import_results
from study_app.web.read_results import BrowserResults

SURE = '\n[task.confidence]\nsteps = 4\nquestion = { en = "How sure?" }\n'
SCALE = ("bad", "poor", "fair", "good", "excellent")
WEB_CASES = CASES | {
    "yes-no with confidence": replace(CASES["yes-no"], task=CASES["yes-no"].task + SURE),
    "rating": Case(
        f'kind = "rating"\nstimulus_s = 0.1\nscale = {list(SCALE)}', SCALE, 'kind = "ratings"', 12,
        "repeats = 1\nblocks = 2\npractice = { trials = 2 }",
    ),
}  # fmt: skip
FHD = load_display("fhd27-60hz")
AS_ONCE = {"opened_s": 0, "past": None, "rates_hz": [], "most": None}
PIECE_PX = 24
"""Edge of the pieces of `alike_in`."""
NO_FAULTS = {"missed": 0.0, "paused": 0.0, "disturbed": 0.0, "killed": 0.0}


@dataclass(frozen=True)
class BuiltWebStudy:
    """A study with the section `[web]`, its stimuli, and its exported folder."""

    study: StudyProtocol
    display: Display
    manifest: Manifest
    stimuli: Path
    out: Path

    @cached_property
    def exported(self) -> dict[str, Any]:
        """The file `study.json`."""
        return json.loads((self.out / "study.json").read_text())

    def session(
        self,
        kernel: Kernel,
        participant: str = "W-1",
        *,
        slot: int = 0,
        rate_hz: float = 60.0,
        luck: int = 1,
        page: Mapping[str, Any] | None = None,
        **faults: float,
    ) -> dict[str, Any]:
        """Let the kernel run a session: its ending, deaths of the page, and the results.

        Where `page` says after how many lines (`most`) nobody goes on: the history (`past`), too.
        """
        begun = {
            "participant": participant, "slot": slot, "slot_from": "drawn", "seed": 77 + luck,
            "places_key": self.exported["design"]["places_key"],
            "language": self.study.text.default_language, "rate_hz": rate_hz, "identifier": None,
        }  # fmt: skip
        return kernel.ask(
            "session", study=self.exported, begun=begun, faults=NO_FAULTS | faults, luck=luck,
            page=AS_ONCE | (page or {}),
        )  # fmt: skip


def with_pixels(study: StudyProtocol, folder: Path) -> Manifest:
    """Fill a folder with the stimuli of a study: noise in the size that the study asks for."""
    plain = virtual_manifest(study, FHD)
    rng = np.random.default_rng(5)
    clips = []
    for clip in plain.clips:
        hashes = []
        for index in range(len(clip.frames_sha256)):
            path = folder / clip.frame_path(index)
            path.parent.mkdir(parents=True, exist_ok=True)
            pixels = rng.integers(0, 256, (clip.height_px, clip.width_px, 3), dtype=np.uint8)
            Image.fromarray(pixels).save(path)
            hashes.append(sha256_file(path))
        clips.append(clip.model_copy(update={"frames_sha256": tuple(hashes)}))
    manifest = plain.model_copy(update={"clips": tuple(clips), "simulated": False})
    write_manifest(folder, manifest)
    return manifest


def for_browsers(study: StudyProtocol, **web: object) -> StudyProtocol:
    """Return the study with a section `[web]`."""
    return study.model_copy(update={"web": Web(gaze="none", **web)})


def built(study: StudyProtocol, folder: Path) -> BuiltWebStudy:
    """Make stimuli and export of a study."""
    manifest = with_pixels(study, folder / "stimuli")
    WebBuild(study, FHD, manifest).write(folder / "stimuli", folder / "out")
    return BuiltWebStudy(study, FHD, manifest, folder / "stimuli", folder / "out")


def cases_in(folders: pytest.TempPathFactory) -> Callable[[str], BuiltWebStudy]:
    """Return what gives a built case by its name, made once."""
    made: dict[str, BuiltWebStudy] = {}

    def of(name: str) -> BuiltWebStudy:
        if name not in made:
            folder = folders.mktemp("case")
            path = folder / "study.toml"
            path.write_text(case_text(WEB_CASES[name]), encoding="utf-8")
            study, _ = load_study(path)
            made[name] = built(for_browsers(study, tolerance_s=0.01), folder)
        return made[name]

    return of


def alike_in(of: BuiltWebStudy, folder: Path) -> BuiltWebStudy:
    """Return the study with stimuli that are one picture but for a square, cut into small pieces.

    Each participant is shown two of the three scenes.
    """
    base = np.add.outer(np.arange(64), np.arange(64)).astype(np.uint8)
    clips = []
    for number, clip in enumerate(of.manifest.clips):
        pixels = np.stack([base, base.T[::-1], 255 - base], axis=-1)
        pixels[30:40, 30:40] = number * 7 % 256
        path = folder / "stimuli" / clip.frame_path(0)
        path.parent.mkdir(parents=True)
        Image.fromarray(pixels).save(path)
        clips.append(clip.model_copy(update={"frames_sha256": (sha256_file(path),)}))
    manifest = of.manifest.model_copy(update={"clips": tuple(clips)})
    write_manifest(folder / "stimuli", manifest)
    study = for_browsers(of.study, tolerance_s=0.01, share=0.67)
    with pytest.MonkeyPatch.context() as patch:
        for module in (packs, export):
            patch.setattr(module, "PIECE_PX", PIECE_PX)
        WebBuild(study, FHD, manifest).write(folder / "stimuli", folder / "out")
    return BuiltWebStudy(study, FHD, manifest, folder / "stimuli", folder / "out")


def brought_home(of: BuiltWebStudy, results: list[str], root: Path) -> list[ImportResult]:
    """Import lines, none of which may be damaged."""
    inbox = BrowserResults()
    inbox.read("results", "".join(results).encode())
    assert not inbox.damaged
    return import_results(inbox, of.study, of.display, of.manifest, root)


Fields = Mapping[str, object] | Callable[[dict[str, Any]], Mapping[str, object]]


def changed(results: list[str], kind: str, fields: Fields) -> tuple[list[str], int]:
    """Change fields of the line in the middle of all of a kind; return all, and its number."""
    places = [n for n, line in enumerate(results) if json.loads(line)["kind"] == kind]
    place = places[len(places) // 2]
    line = json.loads(results[place])
    line |= fields(line) if callable(fields) else fields
    return [*results[:place], json.dumps(line) + "\n", *results[place + 1 :]], place
