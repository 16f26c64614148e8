"""Small moving pictures: the gaze wanders over a picture, or two seeds take turns."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.errors import InputError
from pipeline.foveation.conditions import Foveator
from pipeline.foveation.geometry import Equirectangular, Flat, Geometry, Viewing
from pipeline.named_classes import Choice
from pipeline.pictures import drawing
from pipeline.pictures.drawing import Picture
from protocols.disk.whole_file import write_whole
from stimuli.foveate.condition_sheet import draw_gaze

ENDINGS = (".webp", ".png", ".apng")
LONGEST_PX = 480
"""Longer edge of the moving picture, unless another is asked for."""
FRAMES = 48
FRAME_MS = 100
FLIP_MS = 600
_WEBP = {"quality": 80, "method": 4, "minimize_size": False, "kmin": 1, "kmax": 3}

OnFrame = Callable[[int, int], None]
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


@dataclass(frozen=True, eq=False)
class AnimatedPicture:
    """An encoded picture of shape (H, W, 3), how it is looked at, and what shows it."""

    colour: NDArray[np.float32]
    viewing: Viewing
    choice: Choice
    ctx: moderngl.Context | None = None


def wander(
    path: Path,
    shown: AnimatedPicture,
    *,
    seed: int = 0,
    longest_px: int = LONGEST_PX,
    report: OnFrame = lambda *_: None,
) -> int:
    """Write a moving picture in which the gaze wanders; return its bytes.

    Noise lies on the screen, displacements follow the gaze: what moves beside the mark is what a
    gaze of this speed would move.
    """
    check_ending(path)
    small, viewing = shrunk(shown.colour, shown.viewing, longest_px)
    geometry = viewing.of(small.shape[1], small.shape[0])
    looks = [(gaze, seed, frame) for frame, gaze in enumerate(wandering(geometry, FRAMES))]
    drawn = _drawn(replace(shown, colour=small, viewing=viewing), looks, report)
    return save_moving(path, drawn, FRAME_MS)


def flip(
    path: Path,
    shown: AnimatedPicture,
    gaze_px: tuple[float, float],
    *,
    seeds: tuple[int, int] = (0, 1),
    longest_px: int = 2 * LONGEST_PX,
    report: OnFrame = lambda *_: None,
) -> int:
    """Write a moving picture that flips between two seeds; return its bytes.

    Look at the mark: two metamers are the same there, and hard to tell apart around it.
    """
    check_ending(path)
    small, viewing = shrunk(shown.colour, shown.viewing, longest_px)
    across, down = small.shape[1] / shown.colour.shape[1], small.shape[0] / shown.colour.shape[0]
    gaze = gaze_px[0] * across, gaze_px[1] * down
    looks = [(gaze, seed, 0) for seed in seeds]
    drawn = _drawn(replace(shown, colour=small, viewing=viewing), looks, report)
    return save_moving(path, drawn, FLIP_MS)


def _drawn(
    shown: AnimatedPicture, looks: Sequence[tuple[tuple[float, float], int, int]], report: OnFrame
) -> list[Picture]:
    """Draw a picture for each gaze, seed and number of a frame, with a mark at the gaze."""
    height, width = shown.colour.shape[:2]
    radius_px = max(5.0, min(height, width) / 45)
    foveator = Foveator(
        (height, width), viewing=shown.viewing, method=shown.choice.name, ctx=shown.ctx,
        **shown.choice.parameters,
    )  # fmt: skip
    drawn = []
    try:
        for done, (gaze, seed, frame) in enumerate(looks, 1):
            picture = drawing.of_colour(foveator(shown.colour, gaze, seed=seed, frame=frame))
            drawn.append(draw_gaze(picture, gaze, radius_px))
            report(done, len(looks))
    finally:
        foveator.release()
    return drawn


def save_moving(path: Path, frames: Sequence[Picture], frame_ms: int) -> int:
    """Write frames as a moving picture without end, whole or not at all; return its bytes."""
    check_ending(path)
    images = [Image.fromarray(frame) for frame in frames]
    buffer = io.BytesIO()
    kind = "WEBP" if path.suffix.lower() == ".webp" else "PNG"
    images[0].save(
        buffer, format=kind, save_all=True, append_images=images[1:], duration=frame_ms, loop=0,
        **(_WEBP if kind == "WEBP" else {}),
    )  # fmt: skip
    data = buffer.getvalue()
    write_whole(path, data)
    return len(data)
