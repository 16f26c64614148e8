"""Pictures that metamerlab makes itself for studies, in any size and at the display's angles.

They need no files of yours: seven built-in scenes seen from where they begin, and a wall of printed
notices. Code draws them under our licence, some surfaces from photographs of scikit-image (CC0). A
scene may be looked at in any direction; `street` alone is a place all around.
"""

from __future__ import annotations

import math

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.camera import Camera
from pipeline.errors import InputError
from pipeline.foveation.geometry import FlatGeometry
from pipeline.foveation.view import turn
from protocols.errors import must_be_one_of
from stimuli.rendering.render import WorldRenderer
from stimuli.rendering.world import look_at_pose
from stimuli.scenes.builtin_scenes import SCENES, build_scene, scene_names

NOTICES = "notices"
SEED = 1
"""Seed of every scene: a name is one picture."""
_DRAWN_PX = 2160  # high the wall is drawn; then it is scaled
_SYLLABLES = [first + second for first in "bdfghklmnprstvw" for second in "aeio"]

Colour = NDArray[np.float32]


def picture_names() -> list[str]:
    """Return the name of every picture, as it stands after `builtin:`."""
    return [*scene_names(), NOTICES]


def check_picture_name(name: str) -> None:
    """Refuse a picture that does not exist.

    Raises
    ------
    InputError
        With the nearest name.
    """
    if name not in picture_names():
        raise InputError(must_be_one_of("a built-in picture", name, picture_names()))


def picture_modules(name: str) -> tuple[str, ...]:
    """Return the modules that decide a picture's pixels, for `stimuli.batch.sources`."""
    scene = [entry.module for entry in SCENES if entry.name == name]
    return ("stimuli.scenes.builtin_pictures", *scene)


def builtin_picture(
    name: str,
    geometry: FlatGeometry,
    ctx: moderngl.Context | None,
    *,
    right_deg: float = 0.0,
    down_deg: float = 0.0,
) -> Colour:
    """Make a picture.

    Parameters
    ----------
    geometry : FlatGeometry
        Its size, and how far the eye is: a scene is drawn in the perspective of that eye.
    ctx : moderngl.Context or None
        Scenes need one; notices do not.
    right_deg, down_deg : float
        Where a scene is looked at, from its own direction of view.

    Returns
    -------
    ndarray of float32, shape (H, W, 3)
        Encoded R'G'B' in [0, 1]; each pixel of a scene is the mean of four samples.

    Raises
    ------
    InputError
        If there is no such picture, no OpenGL for a scene, or another direction of what is flat.
    """
    check_picture_name(name)
    if name == NOTICES:
        if right_deg or down_deg:
            raise InputError(f"{NOTICES!r} is a flat picture and has one view; leave view out")
        return notices(geometry.height_px, geometry.width_px)
    if ctx is None:
        raise InputError(
            f"the picture builtin:{name} is rendered, which needs OpenGL; 'metamerlab doctor' says"
            " what is missing"
        )
    world = build_scene(name, SEED)
    pose = look_at_pose(world.viewpoint.position_m, world.viewpoint.look_at_m).copy()
    pose[:3, :3] = pose[:3, :3] @ turn(right_deg, down_deg)
    renderer = WorldRenderer(ctx, world)
    total = np.zeros((geometry.height_px, geometry.width_px, 3), np.float32)
    try:
        for down in (-0.25, 0.25):
            for right in (-0.25, 0.25):
                camera = Camera(
                    geometry.width_px,
                    geometry.height_px,
                    geometry.distance_px,
                    geometry.distance_px,
                    geometry.centre_px[0] + right,
                    geometry.centre_px[1] + down,
                    pose,
                )
                total += renderer.render(camera).colour
    finally:
        renderer.release()
    return np.ascontiguousarray(np.clip(total / 4, 0, 1), np.float32)


def notices(height_px: int, width_px: int) -> Colour:
    """Draw a wall of printed notices: words of several sizes, which no language has.

    Returns
    -------
    ndarray of float32, shape (H, W, 3)
        The same wall in every size: lengths are shares of the height.
    """
    rng = np.random.default_rng(SEED)
    tall = _DRAWN_PX
    wide = max(1, round(tall * width_px / height_px))
    wall = np.empty((tall, wide, 3), np.uint8)
    wall[:] = (181, 172, 158)
    edge = tall / 24
    columns = max(2, math.ceil(wide / tall * 2.6))
    step = wide / columns
    for column in range(-1, columns + 1):
        top = -float(rng.uniform(0, tall / 6))
        while top < tall:
            deep = float(rng.uniform(0.22, 0.45)) * tall
            left = (column + float(rng.uniform(0.03, 0.12))) * step
            paper = tuple(int(value) for value in rng.integers(205, 250, 3))
            ink = tuple(int(value) for value in rng.integers(10, 90, 3))
            _notice(wall, rng, (left, top), (0.86 * step, deep - edge / 2), paper, ink)
            top += deep
    how = cv2.INTER_AREA if height_px <= tall else cv2.INTER_CUBIC
    scaled = cv2.resize(wall, (width_px, height_px), interpolation=how)
    return np.asarray(scaled, np.float32) / np.float32(255)


def _notice(
    wall: NDArray[np.uint8],
    rng: np.random.Generator,
    corner: tuple[float, float],
    size: tuple[float, float],
    paper: tuple[int, ...],
    ink: tuple[int, ...],
) -> None:
    """Put up one sheet: a heading, then lines of smaller print."""
    (left, top), (wide, deep) = corner, size
    shadow = max(1, round(wall.shape[0] / 200))
    lower_right = (round(left + wide), round(top + deep))
    cv2.rectangle(
        wall,
        (round(left) + shadow, round(top) + shadow),
        (lower_right[0] + shadow, lower_right[1] + shadow),
        (120, 112, 100),
        cv2.FILLED,
    )
    cv2.rectangle(wall, (round(left), round(top)), lower_right, paper, cv2.FILLED)
    line = wall.shape[0] * float(rng.choice([0.035, 0.05, 0.07]))
    below = top + 1.4 * line
    while below < top + deep - 0.3 * line:
        _print_line(wall, rng, (left + 0.06 * wide, below), 0.88 * wide, line, ink)
        line = max(0.014, float(rng.choice([0.016, 0.02, 0.026]))) * wall.shape[0]
        below += 1.6 * line


def _print_line(
    wall: NDArray[np.uint8],
    rng: np.random.Generator,
    start: tuple[float, float],
    wide: float,
    line: float,
    ink: tuple[int, ...],
) -> None:
    """Print words from `start` in OpenCV's own letters, about `line` high, as long as they fit."""
    scale = line / 22
    thick = max(1, round(line / 8))
    said = ""
    for _ in range(12):
        word = "".join(rng.choice(_SYLLABLES, int(rng.integers(1, 4))))
        longer = f"{said} {word}".strip()
        if cv2.getTextSize(longer, cv2.FONT_HERSHEY_SIMPLEX, scale, thick)[0][0] > wide:
            break
        said = longer
    place = (round(start[0]), round(start[1]))
    cv2.putText(wall, said, place, cv2.FONT_HERSHEY_SIMPLEX, scale, ink, thick, cv2.LINE_AA)
