"""Pictures of scripts, as arrays: each picture, and the whole screen at one flip.

The window draws the same on the graphics card; a test compares the two, pixel by pixel.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeAlias, assert_never

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from protocols.display import Display
from protocols.phases import Bitmap, rgba_sha256
from protocols.script import (
    Dot,
    Drawn,
    Fill,
    Frames,
    Live,
    Picture,
    Place,
    Ring,
    ScriptPhase,
    StoredPicture,
    TrialScript,
    Words,
)
from protocols.study_file.schema import StudyProtocol
from study_app.pages import words_image

PixelBytes: TypeAlias = NDArray[np.uint8]
Bitmaps: TypeAlias = Mapping[str, Bitmap]
"""Pictures that a task draws itself, by their hashes."""
INNER_SHARE = 1 / 3
"""Inner disc and cross hair of the target as a share of its diameter: 0.2 of 0.6 deg."""
_FINER = 8
"""Samples per pixel edge of what is drawn by its geometry."""


def bitmaps_of(study: StudyProtocol, display: Display) -> dict[str, Bitmap]:
    """Return every picture that the study's task draws itself."""
    task = study.task
    phases = (*task.phases(study.pool, display), *task.phases_after(study.pool, display))
    shown = (entry for phase in phases for entry in phase.show)
    return {entry.sha256: entry for entry in shown if isinstance(entry, Bitmap)}


def drawn(of: Drawn, bitmaps: Bitmaps) -> PixelBytes:
    """Return a picture of shape (height, width, 4): RGBA with straight alpha.

    Raises
    ------
    StudyError
        If no font of this machine writes the words, or they do not fit the screen.
    """
    match of:
        case Dot():
            return target_image(of)
        case Ring():
            return ring_image(of)
        case Words():
            return words_image(of)
        case StoredPicture():
            rgba = np.frombuffer(bitmaps[of.sha256].rgba, np.uint8)
            return rgba.reshape(of.size_px[1], of.size_px[0], 4)
        case _:
            assert_never(of)


def target_image(dot: Dot) -> PixelBytes:
    """Draw the fixation target, black on the background's grey, with smooth edges.

    Thaler, Schuetz, Goodale and Gegenfurtner 2013, "What is the best fixation target? The effect of
    target shape on stability of fixational eye movements", Vision Research 76: the combination of
    bull's eye and cross hair (their shape ABC) gave the least dispersion. Outer disc 0.6 deg, inner
    disc and cross hair 0.2 deg; scaled here to the diameter that the protocol asks for.

    Returns
    -------
    ndarray of shape (edge_px, edge_px, 4)
        RGBA with straight alpha.
    """
    x, y = _samples(dot.edge_px, dot.edge_px / 2, dot.edge_px / 2)
    distance = np.hypot(x, y)
    inner = dot.diameter_px * INNER_SHARE / 2
    disc = distance <= dot.diameter_px / 2
    cross = disc & ((abs(x) <= inner) | (abs(y) <= inner)) & (distance > inner)
    alpha, light = _covered(disc), _covered(cross)
    grey = np.divide(light, alpha, out=np.zeros_like(alpha), where=alpha > 0) * dot.grey
    return _inked(np.rint(grey)[..., None], alpha)


def ring_image(ring: Ring) -> PixelBytes:
    """Draw a Landolt ring by its geometry, smooth at the edge of pixels.

    Stroke and gap are a fifth of its height (ISO 8596); the gap has parallel sides.

    Returns
    -------
    ndarray of shape (edge_px, edge_px, 4)
        RGBA; alpha is the share of each pixel that the ring covers.
    """
    height = ring.height_px
    x, down = _samples(ring.edge_px, *ring.middle_px)
    y = -down  # up, as angles count
    radius = np.hypot(x, y)
    inked = (radius <= height / 2) & (radius >= 0.3 * height)
    if ring.gap_deg is not None:
        angle = math.radians(ring.gap_deg)
        along = x * math.cos(angle) + y * math.sin(angle)
        across = -x * math.sin(angle) + y * math.cos(angle)
        inked &= ~((along > 0) & (np.abs(across) <= 0.1 * height))
    return _inked(ring.grey, _covered(inked))


def _samples(edge: int, x: float, y: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the places of samples of a square, right of and below a point of it, in pixels."""
    steps = (np.arange(edge * _FINER) + 0.5) / _FINER
    return steps[None, :] - x, steps[:, None] - y


def _covered(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the share of each pixel whose samples are set."""
    edge = len(mask) // _FINER
    shares: NDArray[np.float64] = mask.reshape(edge, _FINER, edge, _FINER).mean(axis=(1, 3))
    return shares


def _inked(grey: NDArray[np.float64] | int, alpha: NDArray[np.float64]) -> PixelBytes:
    image = np.empty((*alpha.shape, 4), np.uint8)
    image[..., :3] = grey
    image[..., 3] = np.rint(255 * alpha)
    return image


def write_pictures(
    folder: Path, scripts: Sequence[TrialScript], study: StudyProtocol, display: Display
) -> list[TrialScript]:
    """Write every picture of scripts, ``HASH.png``; return the scripts with these hashes.

    The hash is that of `protocols.phases.rgba_sha256`.
    """
    bitmaps, known = bitmaps_of(study, display), dict[Drawn, StoredPicture]()

    def stored(picture: Picture) -> Picture:
        if picture.of not in known:
            image = drawn(picture.of, bitmaps)
            height, width, _ = image.shape
            sha256 = rgba_sha256(width, height, image.tobytes())
            Image.fromarray(image).save(folder / f"{sha256}.png")
            known[picture.of] = StoredPicture(size_px=(width, height), sha256=sha256)
        return picture.model_copy(update={"of": known[picture.of]})

    def phase(one: ScriptPhase) -> ScriptPhase:
        show = tuple(stored(e) if isinstance(e, Picture) else e for e in one.show)
        follows = {name: stored(picture) for name, picture in one.follows.items()}
        return one.model_copy(update={"show": show, "follows": follows})

    return [one.model_copy(update={"phases": tuple(map(phase, one.phases))}) for one in scripts]


def paint(
    script: TrialScript,
    phase: ScriptPhase,
    stimuli: Mapping[int, Sequence[PixelBytes]],
    bitmaps: Bitmaps,
    *,
    refreshes: int = 0,
    notice: Picture | None = None,
) -> PixelBytes:
    """Return the whole screen, shape (height, width, 3), so many refreshes into a phase.

    Parameters
    ----------
    stimuli : mapping
        Frames of the trial's stimuli, shape (height, width, 3), by number; of one that follows the
        gaze the one frame as it was drawn.
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
            case Live(stimulus=stimulus, at=at):
                lay(screen, stimuli[stimulus][0], at)
            case Picture(of=of, at=at):
                lay(screen, drawn(of, bitmaps), at)
            case Fill(rect=(left, top, width, height), grey=grey):
                lay(screen, np.full((height, width, 3), grey, np.uint8), (left, top))
            case _:
                assert_never(entry)
    return screen


def lay(screen: PixelBytes, image: PixelBytes, at: Place) -> None:
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
