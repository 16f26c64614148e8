"""Pictures of one trial, in the order in which they stood on the screen."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from PIL import Image as PillowImage

from protocols.display import Display
from protocols.journal import Attempt
from protocols.manifest import Manifest
from protocols.schema import StudyProtocol
from protocols.script import example_scripts
from protocols.tasks.pairs import PreferenceAnalysis
from stimuli.pictures import save_picture
from stimuli.whole_file import write_whole
from study_app.cli.demo.sitting import Flip
from study_app.cli.demo.watcher import Image
from study_app.paint import bitmaps_of, paint

STRIP_NAME = "trial.json"
SHOTS = {"fixate": 1, "first": 4, "gap": 1, "second": 4, "respond": 1}
"""How many pictures of each phase."""
Source = Literal["screen", "log"]


@dataclass(frozen=True)
class Shot:
    """One picture of the strip."""

    file: str
    phase: str
    t_s: float
    """Since the trial's first flip."""
    flip: int
    frame: str
    """SHA-256 of the clip frame's file; empty where none is shown."""


@dataclass(frozen=True)
class Strip:
    """A trial in pictures."""

    source: Source
    """`screen`: read from the screen's memory while it was shown. `log`: drawn again from the
    frames that the log names."""
    participant: str
    trial: str
    scene: str
    size: str
    first: str
    second: str
    chosen: str
    rt_s: float
    missed: int
    """Refreshes missed in the whole attempt."""
    shots: tuple[Shot, ...]


def worth(attempt: Attempt, protocol: StudyProtocol) -> int:
    """How much an attempt is worth showing: 0 not at all, 3 the primary comparison, large holes."""
    if attempt.outcome != "completed" or attempt.role != "main":
        return 0
    analysis, row = protocol.analysis, protocol.task.row(attempt)
    wanted: set[object] = set()
    if isinstance(analysis, PreferenceAnalysis):
        wanted = {analysis.primary.method, analysis.primary.against}
    is_primary = {row["first"], row["second"]} == wanted
    is_large = row["size"] == protocol.warped.sizes[-1].name
    return 1 + is_primary + (is_primary and is_large)


def chosen_flips(flips: list[Flip], available: Mapping[int, Image] | None) -> list[Flip]:
    """Choose evenly within each phase, among the flips of which there is a picture."""
    chosen = []
    for phase, count in SHOTS.items():
        of_phase = [
            flip
            for flip in flips
            if flip.phase == phase
            and (flip.number in available if available is not None else bool(flip.frame))
        ]
        if of_phase:
            # In the middle of equal parts: the very first flip of a phase tells least.
            places = (np.arange(count) + 0.5) / count * len(of_phase)
            chosen += [of_phase[index] for index in sorted({int(place) for place in places})]
    return chosen


def write_strip(
    folder: Path,
    source: Source,
    participant: str,
    attempt: Attempt,
    protocol: StudyProtocol,
    flips: list[Flip],
    pictures: Mapping[int, Image],
) -> None:
    """Write the chosen pictures and, last, what they are."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / STRIP_NAME).unlink(missing_ok=True)
    for old in folder.glob("[0-9][0-9]-*.png"):
        old.unlink()
    shots = []
    for place, flip in enumerate(flips):
        name = f"{place:02d}-{flip.phase}.png"
        save_picture(folder / name, pictures[flip.number])
        shots.append(
            Shot(name, flip.phase, round(flip.t_s, 4), flip.number, flip.frame)
        )  # fmt: skip
    row = protocol.task.row(attempt)
    strip = Strip(
        source=source,
        participant=participant,
        trial=attempt.trial,
        scene=str(row["scene"]),
        size=str(row["size"]),
        first=str(row["first"]),
        second=str(row["second"]),
        chosen=str(row["chosen"] or ""),
        rt_s=attempt.rt_s or 0.0,
        missed=attempt.missed,
        shots=tuple(shots),
    )
    write_whole(folder / STRIP_NAME, (json.dumps(asdict(strip), indent=1) + "\n").encode("utf-8"))


def read_strip_file(folder: Path) -> Strip | None:
    """Return the strip that was written there, or None."""
    try:
        raw = json.loads((folder / STRIP_NAME).read_text(encoding="utf-8"))
        shots = tuple(Shot(**shot) for shot in raw.pop("shots"))
        strip = Strip(shots=shots, **raw)
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return None
    return strip if all((folder / shot.file).is_file() for shot in shots) else None


def redraw(
    flips: list[Flip],
    clips: Path,
    manifest: Manifest,
    protocol: StudyProtocol,
    display: Display,
) -> dict[int, Image]:
    """Return what the screen must have shown at flips with a clip, from the frames on disk."""
    paths = {
        sha: clip.frame_path(index)
        for clip in manifest.clips
        for index, sha in enumerate(clip.frames_sha256)
    }
    script = example_scripts(protocol, display)[0]
    phases = dict(zip((phase.name for phase in script.phases), script.frames, strict=True))
    found = {}
    for flip in flips:
        stimuli = {}
        for entry, sha in zip(phases[flip.phase], flip.frame.split(), strict=True):
            with PillowImage.open(clips / paths[sha]) as image:
                stimuli[entry.stimulus] = [np.asarray(image.convert("RGB"))]
        shown = next(phase for phase in script.phases if phase.name == flip.phase)
        found[flip.number] = paint(script, shown, stimuli, bitmaps_of(protocol, display))
    return found
