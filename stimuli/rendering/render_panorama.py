"""All that is around an eye in a world, as an equirectangular panorama: six views, put together."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.camera import Camera
from pipeline.errors import InputError
from pipeline.foveation.geometry import Equirectangular, EquirectangularGeometry
from stimuli.rendering.render import WorldRenderer
from stimuli.rendering.world import World, look_at_pose

LEAST_PX, MOST_PX = 16, 4096
"""Height of a panorama: a view of a higher one is more than drivers hold."""
_FINER = 2  # samples per edge of a pixel at the horizon
_MARGIN_PX = 2  # beyond a face's edge, for what lies between pixels
_ROWS = 128  # worked out at a time

Colour = NDArray[np.float32]


def panorama_of(
    ctx: moderngl.Context,
    world: World,
    height_px: int,
    *,
    report: Callable[[int, int], None] = lambda _done, _total: None,
) -> Colour:
    """Look around from a world's viewpoint.

    Parameters
    ----------
    world : World
        Its viewpoint's direction, made level, is the panorama's middle.
    height_px : int
        The panorama is twice as wide; 180 degrees.
    report : callable
        Told faces done, and faces in all.

    Returns
    -------
    ndarray of float32, shape (height_px, 2 height_px, 3)
        Encoded R'G'B' in [0, 1]; at the horizon each pixel is the mean of four samples.

    Raises
    ------
    InputError
        If the height lies outside of 16 to 4096, or the viewpoint looks straight up or down.
    """
    if not LEAST_PX <= height_px <= MOST_PX:
        raise InputError(f"a panorama must be {LEAST_PX} to {MOST_PX} px high (got {height_px} px)")
    geometry = Equirectangular().of(2 * height_px, height_px)
    edge_px = math.ceil(_FINER * geometry.width_px / math.pi)
    level = _level_pose(world)
    total = np.zeros((height_px, 2 * height_px, 3), np.float32)
    renderer = WorldRenderer(ctx, world)
    try:
        for number, turned in enumerate(_faces()):
            pose = level.copy()
            pose[:3, :3] = level[:3, :3] @ turned
            middle = edge_px / 2 + _MARGIN_PX
            edge = edge_px + 2 * _MARGIN_PX
            half = edge_px / 2
            camera = Camera(edge, edge, half, half, middle, middle, pose)
            _add_face(total, renderer.render(camera).colour, camera, turned, geometry)
            report(number + 1, 6)
    finally:
        renderer.release()
    return np.clip(total / _FINER**2, 0, 1)


def _level_pose(world: World) -> NDArray[np.float64]:
    """The viewpoint's pose, its direction turned to the horizon."""
    place = np.asarray(world.viewpoint.position_m, np.float64)
    ahead = np.asarray(world.viewpoint.look_at_m, np.float64) - place
    ahead[1] = 0
    if not np.linalg.norm(ahead) > 0:
        raise InputError(
            "a panorama's viewpoint must not look straight up or down: its middle would have no"
            " direction"
        )
    viewpoint = replace(world.viewpoint, look_at_m=tuple(place + ahead))
    return look_at_pose(viewpoint.position_m, viewpoint.look_at_m)


def _faces() -> list[NDArray[np.float64]]:
    """Rotations that take (0, 0, 1) to each of six directions: around, then up and down."""
    around = []
    for quarter in range(4):
        cosine, sine = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarter]
        around.append(np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]], float))
    up = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float)
    return [*around, up, up.T]


def _add_face(
    total: Colour,
    seen: Colour,
    camera: Camera,
    turned: NDArray[np.float64],
    geometry: EquirectangularGeometry,
) -> None:
    """Add a face's samples to the panorama where it is the nearest of the six."""
    columns = np.arange(geometry.width_px)[None, :]
    axis = np.abs(turned[:, 2]).argmax()
    for first in range(0, geometry.height_px, _ROWS):
        rows = np.arange(first, min(first + _ROWS, geometry.height_px))[:, None]
        for sample in np.ndindex(_FINER, _FINER):
            down, right = ((np.asarray(sample) + 0.5) / _FINER).tolist()
            rays = geometry.directions(columns + right, rows + down)
            ahead = rays @ turned[:, 2]  # the largest of the six where the face is the nearest
            inside = (np.abs(rays).argmax(axis=-1) == axis) & (ahead > 0)
            local = rays[inside] @ turned
            x = camera.cx_px + camera.fx_px * local[:, 0] / local[:, 2] - 0.5
            y = camera.cy_px + camera.fy_px * local[:, 1] / local[:, 2] - 0.5
            total[first : first + _ROWS][inside] += _between(seen, x, y)


def _between(picture: Colour, x: NDArray[np.float64], y: NDArray[np.float64]) -> Colour:
    """Bilinear values at places counted from the first pixel's middle."""
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    right, down = (x - left)[:, None], (y - top)[:, None]
    above = (1 - right) * picture[top, left] + right * picture[top, left + 1]
    below = (1 - right) * picture[top + 1, left] + right * picture[top + 1, left + 1]
    return np.asarray((1 - down) * above + down * below, np.float32)
