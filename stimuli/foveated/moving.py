"""Small moving pictures: the gaze wanders over a picture, or two seeds take turns."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.errors import InputError
from pipeline.foveation.conditions import Foveator
from pipeline.foveation.geometry import Equirectangular, Flat, Geometry, Viewing
from protocols.whole_file import write_whole
from stimuli import pictures
from stimuli.choice import Choice
from stimuli.foveated.rings import draw_gaze
from stimuli.pictures import Picture

ENDINGS = (".webp", ".png", ".apng")
LONGEST_PX = 480
"""Longer edge of the moving picture, unless another is asked for."""
FRAMES = 48
FRAME_MS = 100
FLIP_MS = 600
_QUALITY = 80  # of WebP

Report = Callable[[int, int], None]
"""Called with frames done and frames in all."""


def check_ending(path: Path) -> None:
    """Require a file that can hold a moving picture.

    Raises
    ------
    InputError
        Naming the endings.
    """
    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"{path}: a moving picture must end in {', '.join(ENDINGS)}")


def shrunk(
    colour: NDArray[np.float32], viewing: Viewing, longest_px: int
) -> tuple[NDArray[np.float32], Viewing]:
    """Scale a picture down, seen from as near as its new pixels ask for; never up."""
    height, width = colour.shape[:2]
    share = longest_px / max(height, width)
    if share >= 1:
        return colour, viewing
    if isinstance(viewing, Equirectangular):
        down = max(1, round(share * height))
        size = (2 * down, down)
        seen: Viewing = viewing
    else:
        size = max(1, round(share * width)), max(1, round(share * height))
        full = viewing.of(width, height)
        seen = Flat(distance_px=full.distance_px * size[0] / width)
    small = cv2.resize(colour, size, interpolation=cv2.INTER_AREA)
    return np.clip(np.asarray(small, np.float32).reshape(size[1], size[0], 3), 0, 1), seen


def wandering(geometry: Geometry, count: int) -> list[tuple[float, float]]:
    """A closed smooth path over the middle four fifths of a picture, `count` places.

    Two turns down for three across (Lissajous): every quarter is visited, and no place is passed
    twice in the same direction.
    """
    if count < 2:
        raise InputError(f"a wandering gaze needs at least 2 frames (got {count})")
    places = []
    for index in range(count):
        turn = 2 * math.pi * index / count
        x = 0.5 + 0.38 * math.sin(2 * turn + 0.25 * math.pi)
        y = 0.5 + 0.36 * math.sin(turn)
        places.append((x * geometry.width_px, y * geometry.height_px))
    return places


def wander(
    path: Path,
    colour: NDArray[np.float32],
    viewing: Viewing,
    choice: Choice,
    *,
    seed: int = 0,
    frames: int = FRAMES,
    longest_px: int = LONGEST_PX,
    ctx: moderngl.Context | None = None,
    report: Report | None = None,
) -> int:
    """Write a moving picture in which the gaze wanders; return its bytes.

    Noise lies on the screen, displacements follow the gaze: what moves beside the mark is what a
    gaze of this speed would move.
    """
    check_ending(path)
    small, seen = shrunk(colour, viewing, longest_px)
    foveator = _foveator(small, seen, choice, ctx)
    shown = []
    radius_px = max(5.0, min(small.shape[:2]) / 45)
    try:
        gazes = wandering(foveator.geometry, frames)
        for index, gaze in enumerate(gazes):
            picture = pictures.of_colour(foveator(small, gaze, seed=seed, frame=index))
            shown.append(draw_gaze(picture, gaze, radius_px))
            if report is not None:
                report(index + 1, frames)
    finally:
        foveator.release()
    return save_moving(path, shown, FRAME_MS)


def flip(
    path: Path,
    colour: NDArray[np.float32],
    gaze_px: tuple[float, float],
    viewing: Viewing,
    choice: Choice,
    *,
    seeds: tuple[int, int] = (0, 1),
    longest_px: int = 2 * LONGEST_PX,
    ctx: moderngl.Context | None = None,
    report: Report | None = None,
) -> int:
    """Write a moving picture that flips between two seeds; return its bytes.

    Look at the mark: two metamers are the same there, and hard to tell apart around it.
    """
    check_ending(path)
    small, seen = shrunk(colour, viewing, longest_px)
    share = small.shape[1] / colour.shape[1]
    gaze = gaze_px[0] * share, gaze_px[1] * small.shape[0] / colour.shape[0]
    foveator = _foveator(small, seen, choice, ctx)
    radius_px = max(5.0, min(small.shape[:2]) / 45)
    shown = []
    try:
        for index, seed in enumerate(seeds):
            picture = pictures.of_colour(foveator(small, gaze, seed=seed))
            shown.append(draw_gaze(picture, gaze, radius_px))
            if report is not None:
                report(index + 1, 2)
    finally:
        foveator.release()
    return save_moving(path, shown, FLIP_MS)


def save_moving(path: Path, frames: Sequence[Picture], frame_ms: int) -> int:
    """Write frames as a moving picture without end, whole or not at all; return its bytes."""
    check_ending(path)
    images = [Image.fromarray(frame) for frame in frames]
    buffer = io.BytesIO()
    if path.suffix.lower() == ".webp":
        images[0].save(
            buffer, format="WEBP", save_all=True, append_images=images[1:], duration=frame_ms,
            loop=0, quality=_QUALITY, method=4, minimize_size=False, kmin=1, kmax=3,
        )  # fmt: skip
    else:
        images[0].save(
            buffer, format="PNG", save_all=True, append_images=images[1:], duration=frame_ms,
            loop=0,
        )  # fmt: skip
    data = buffer.getvalue()
    write_whole(path, data)
    return len(data)


def _foveator(
    colour: NDArray[np.float32], viewing: Viewing, choice: Choice, ctx: moderngl.Context | None
) -> Foveator:
    size = (colour.shape[0], colour.shape[1])
    return Foveator(size, viewing=viewing, method=choice.name, ctx=ctx, **choice.parameters)
