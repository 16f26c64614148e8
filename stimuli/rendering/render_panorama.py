"""All that is around an eye in a world, as an equirectangular panorama: six views, put together.

Pictures to look at are anti-aliased; those with distance, for a warp, have one sample a pixel.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.camera import Camera
from pipeline.errors import InputError
from pipeline.foveation.geometry import (
    Equirectangular,
    EquirectangularGeometry,
    Flat,
    FlatGeometry,
)
from pipeline.frame import Bools, Floats, PanoramaFrame
from stimuli.rendering.render import WorldRenderer
from stimuli.rendering.world import World, look_at_pose

LEAST_PX, MOST_PX = 16, 4096
"""Height of a panorama: a view of a higher one is more than drivers hold."""
_FINER = 2  # samples per edge of a pixel at the horizon
_FINER_WITH_DISTANCE = 3
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
    geometry = _geometry(height_px, MOST_PX)
    renderer = WorldRenderer(ctx, world)
    try:
        total = np.zeros((height_px, 2 * height_px, 3), np.float32)
        for camera, turned in _views(world, geometry, _FINER, report):
            seen = renderer.render(camera).colour
            for rows, inside, rays in _samples(turned, geometry, _FINER):
                total[rows][inside] += _between(seen, *_places(camera, rays))
    finally:
        renderer.release()
    return np.clip(total / _FINER**2, 0, 1)


def surroundings_of(
    renderer: WorldRenderer,
    height_px: int,
    *,
    move_m: Floats | None = None,
    report: Callable[[int, int], None] = lambda _done, _total: None,
) -> PanoramaFrame:
    """Look around from a world's viewpoint, or a place beside it, with distance.

    One sample a pixel, along its own ray: the nearest sample of a finer view, carried on to the ray
    by its surface's slope. So nothing is mixed along edges.

    Parameters
    ----------
    move_m : ndarray of shape (3,), optional
        Right, down, and to the panorama's middle.

    Raises
    ------
    InputError
        As `panorama_of`; with distance, at most 2048 px high.
    """
    geometry = _geometry(height_px, MOST_PX // 2)
    colour = np.zeros((height_px, 2 * height_px, 3), np.float32)
    distance_m = np.full((height_px, 2 * height_px), np.inf, np.float32)
    finer = _FINER_WITH_DISTANCE
    for camera, turned in _views(renderer.world, geometry, finer, report, move_m):
        seen = renderer.render(camera)
        planes = np.dstack([seen.colour, 1 / seen.depth_m])
        for rows, inside, rays in _samples(turned, geometry, 1):
            found = _carried_on(planes, *_places(camera, rays))
            colour[rows][inside] = found[:, :3]
            with np.errstate(divide="ignore"):
                distance_m[rows][inside] = 1 / (found[:, 3] * rays[:, 2])
    return PanoramaFrame(colour.clip(0, 1), distance_m)


def view_camera(world: World, geometry: FlatGeometry, turned: Floats, move_m: Floats) -> Camera:
    """Camera of a flat view out of a world's panorama, moved along the panorama's axes."""
    pose = level_pose(world)
    pose[:3, 3] += pose[:3, :3] @ move_m
    pose[:3, :3] = pose[:3, :3] @ turned
    lens = (geometry.distance_px, geometry.distance_px, *geometry.centre_px)
    return Camera(geometry.width_px, geometry.height_px, *lens, pose)


def _geometry(height_px: int, most_px: int) -> EquirectangularGeometry:
    if not LEAST_PX <= height_px <= most_px:
        raise InputError(
            f"a panorama must be {LEAST_PX} to {most_px} px high"
            f"{' with distance' if most_px < MOST_PX else ''} (got {height_px} px)"
        )
    return Equirectangular().of(2 * height_px, height_px)


def _views(
    world: World,
    geometry: EquirectangularGeometry,
    finer: int,
    report: Callable[[int, int], None],
    move_m: Floats | None = None,
) -> Iterator[tuple[Camera, Floats]]:
    """Six cameras around an eye, and the rotation of each."""
    edge_px = math.ceil(finer * geometry.width_px / math.pi)
    edge = edge_px + 2 * _MARGIN_PX
    view = Flat(distance_px=edge_px / 2).of(edge, edge)
    for number, turned in enumerate(_faces()):
        yield view_camera(world, view, turned, np.zeros(3) if move_m is None else move_m), turned
        report(number + 1, 6)


def level_pose(world: World) -> NDArray[np.float64]:
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


def _samples(
    turned: Floats, geometry: EquirectangularGeometry, finer: int
) -> Iterator[tuple[slice, Bools, Floats]]:
    """Samples of a panorama's pixels to which a face is the nearest of the six.

    Rows, which of their pixels, and rays in the face's axes, of shape (n, 3).
    """
    columns = np.arange(geometry.width_px)[None, :]
    axis = np.abs(turned[:, 2]).argmax()
    for first in range(0, geometry.height_px, _ROWS):
        rows = slice(first, min(first + _ROWS, geometry.height_px))
        for sample in np.ndindex(finer, finer):
            down, right = ((np.asarray(sample) + 0.5) / finer).tolist()
            y = np.arange(rows.start, rows.stop)[:, None] + down
            rays = geometry.directions(columns + right, y)
            ahead = rays @ turned[:, 2]  # the largest of the six where the face is the nearest
            inside = (np.abs(rays).argmax(axis=-1) == axis) & (ahead > 0)
            yield rows, inside, rays[inside] @ turned


def _places(camera: Camera, rays: Floats) -> tuple[Floats, Floats]:
    """Places in a camera's picture, counted from the first pixel's middle."""
    x = camera.cx_px + camera.fx_px * rays[:, 0] / rays[:, 2] - 0.5
    y = camera.cy_px + camera.fy_px * rays[:, 1] / rays[:, 2] - 0.5
    return x, y


def _carried_on(picture: Colour, x: Floats, y: Floats) -> Colour:
    """Values at places counted from the first pixel's middle, of the nearest pixel's own surface.

    Of the steps to both sides the lesser is the surface's, and none if they disagree: colours of a
    plane, and its nearness, which is linear in a picture, are exact.
    """
    column, row = np.rint(x).astype(int), np.rint(y).astype(int)
    here = picture[row, column]
    found = here.copy()
    for down, right, aside in ((0, 1, x - column), (1, 0, y - row)):
        before = here - picture[row - down, column - right]
        after = picture[row + down, column + right] - here
        lesser = np.where(np.abs(before) < np.abs(after), before, after)
        found += np.where(before * after > 0, lesser, 0) * aside[:, None]
    return np.asarray(found, np.float32)


def _between(picture: Colour, x: NDArray[np.float64], y: NDArray[np.float64]) -> Colour:
    """Bilinear values at places counted from the first pixel's middle."""
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    right, down = (x - left)[:, None], (y - top)[:, None]
    above = (1 - right) * picture[top, left] + right * picture[top, left + 1]
    below = (1 - right) * picture[top + 1, left] + right * picture[top + 1, left + 1]
    return np.asarray((1 - down) * above + down * below, np.float32)
