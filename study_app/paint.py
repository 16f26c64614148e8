"""What scripts show, as arrays: each picture, and the whole screen at one flip.

The window draws the same on the graphics card; a test compares the two, pixel by pixel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeAlias, assert_never

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from protocols.display import Display
from protocols.phases import Bitmap, rgba_sha256
from protocols.schema import StudyProtocol
from protocols.script import (
    Dot,
    Drawn,
    Fill,
    Frames,
    Picture,
    Place,
    Ring,
    ScriptPhase,
    Stored,
    TrialScript,
    Words,
    example_scripts,
)
from study_app.optotype import ring_image
from study_app.pages import words_image
from study_app.target import target_image

Pixels: TypeAlias = NDArray[np.uint8]
Bitmaps: TypeAlias = Mapping[str, Bitmap]
"""What a task draws itself, by its hash."""


def bitmaps_of(study: StudyProtocol, display: Display) -> dict[str, Bitmap]:
    """Return every picture that the study's task draws itself."""
    task = study.task
    phases = (*task.phases(study.pool, display), *task.phases_after(study.pool, display))
    shown = (entry for phase in phases for entry in phase.show)
    return {entry.sha256: entry for entry in shown if isinstance(entry, Bitmap)}


def check_pictures(study: StudyProtocol, display: Display, language: str) -> None:
    """Refuse a study of which a trial's picture cannot be drawn, before anything is shown.

    Raises
    ------
    StudyError
        As `drawn` does.
    """
    bitmaps = bitmaps_of(study, display)
    scripts = example_scripts(study, display, language)
    for of in dict.fromkeys(picture.of for script in scripts for picture in script.pictures()):
        drawn(of, bitmaps)


def drawn(of: Drawn, bitmaps: Bitmaps) -> Pixels:
    """Return a picture of shape (height, width, 4): RGBA with straight alpha.

    Raises
    ------
    StudyError
        If no font of this machine writes the words, or labels do not fit beside each other.
    """
    match of:
        case Dot():
            return target_image(of)
        case Ring():
            return ring_image(of)
        case Words():
            return words_image(of)
        case Stored():
            rgba = np.frombuffer(bitmaps[of.sha256].rgba, np.uint8)
            return rgba.reshape(of.size_px[1], of.size_px[0], 4)
        case _:
            assert_never(of)


def write_pictures(
    folder: Path, scripts: Sequence[TrialScript], study: StudyProtocol, display: Display
) -> list[TrialScript]:
    """Write every picture of scripts, ``HASH.png``; return the scripts with these hashes.

    The hash is that of `protocols.phases.rgba_sha256`.
    """
    bitmaps, known = bitmaps_of(study, display), dict[Drawn, Stored]()

    def stored(picture: Picture) -> Picture:
        if picture.of not in known:
            image = drawn(picture.of, bitmaps)
            height, width, _ = image.shape
            sha256 = rgba_sha256(width, height, image.tobytes())
            Image.fromarray(image).save(folder / f"{sha256}.png")
            known[picture.of] = Stored(size_px=(width, height), sha256=sha256)
        return picture.model_copy(update={"of": known[picture.of]})

    def phase(one: ScriptPhase) -> ScriptPhase:
        show = tuple(stored(e) if isinstance(e, Picture) else e for e in one.show)
        follows = {name: stored(picture) for name, picture in one.follows.items()}
        return one.model_copy(update={"show": show, "follows": follows})

    return [one.model_copy(update={"phases": tuple(map(phase, one.phases))}) for one in scripts]


def paint(
    script: TrialScript,
    phase: ScriptPhase,
    stimuli: Mapping[int, Sequence[Pixels]],
    bitmaps: Bitmaps,
    *,
    refreshes: int = 0,
    notice: Picture | None = None,
) -> Pixels:
    """Return the whole screen, shape (height, width, 3), so many refreshes into a phase.

    Parameters
    ----------
    stimuli : mapping
        Frames of the trial's stimuli, shape (height, width, 3), by number.
    notice : Picture, optional
        One of those that may follow, drawn first.
    """
    across, down = script.size_px
    screen = np.full((down, across, 3), script.background, np.uint8)
    for entry in (*([notice] if notice else ()), *phase.show):
        match entry:
            case Frames(stimulus=stimulus, at=at, crop=crop):
                frame = stimuli[stimulus][entry.frame(refreshes)]
                if crop is not None:
                    left, top, width, height = crop
                    frame = frame[top : top + height, left : left + width]
                lay(screen, frame, at)
            case Picture(of=of, at=at):
                lay(screen, drawn(of, bitmaps), at)
            case Fill(rect=(left, top, width, height), grey=grey):
                lay(screen, np.full((height, width, 3), grey, np.uint8), (left, top))
            case _:
                assert_never(entry)
    return screen


def lay(screen: Pixels, image: Pixels, at: Place) -> None:
    """Lay what of an image is on the screen over it; RGBA is blended."""
    left, top = at[0] + screen.shape[1] // 2, at[1] + screen.shape[0] // 2
    part = image[max(0, -top) :, max(0, -left) :]
    below = screen[max(0, top) :, max(0, left) :][: len(part), : part.shape[1]]
    part = part[: below.shape[0], : below.shape[1]]
    if part.shape[2] == 3:
        below[:] = part
        return
    alpha = part[..., 3:] / np.float32(255)
    below[:] = np.rint(part[..., :3] * alpha + below * (1 - alpha))
