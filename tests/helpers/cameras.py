"""Cameras by their field of view, the way back from a picture into the world, and a known room.

The room is in closed form: what every ray shows, and how far it goes, from any place in it.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.camera import UPRIGHT, Camera, flow_between
from pipeline.foveation.geometry import Equirectangular, Flat, pixel_centres
from pipeline.foveation.view import turn
from pipeline.frame import PanoramaFrame, SourceFrame, TargetWindow
from pipeline.warp.gpu import warp_frame

HALF_M, UP_M, DOWN_M = 4.0, 1.6, 1.5
PILLARS = (
    (1.2, 1.8, 0.2), (-1.0, 2.0, 0.15), (1.8, -0.6, 0.25), (-1.6, -0.4, 0.2), (0.4, -2.0, 0.2),
    (-0.6, -1.7, 0.15),
)  # fmt: skip
"""Place to the right and ahead, and radius."""
BALLS = ((0.3, -0.8, 0.2, 0.25), (-0.2, 0.9, 0.1, 0.25))
"""A lamp near the zenith and a stool near the nadir: x right, y down, z ahead, radius."""
MOVE_M = np.array([0.25, 0.1, -0.1])
VIEWS = {
    "ahead": (0, 0), "seam": (180, 0), "up": (0, -60), "zenith": (0, -90), "nadir": (40, 90),
    "behind": (180, 50),
}  # fmt: skip


def wide_camera(
    width_px: int,
    height_px: int,
    horizontal_deg: float,
    world_from_camera: NDArray[np.float64] = UPRIGHT,
) -> Camera:
    """Return a camera with square pixels and a centred principal point."""
    focal_px = width_px / 2 / np.tan(np.radians(horizontal_deg) / 2)
    centre = width_px / 2, height_px / 2
    return Camera(width_px, height_px, focal_px, focal_px, *centre, world_from_camera)


def unprojected(camera: Camera, position_px: NDArray[np.float64], depth_m: NDArray[np.floating]):
    """Return world points at image positions (..., 2) and depths (...), shape (..., 3), metres."""
    points = camera._rays(position_px) * np.asarray(depth_m, np.float64)[..., None]
    return points @ camera.world_from_camera[:3, :3].T + camera.world_from_camera[:3, 3]


def look_along(rays, origin_m=(0, 0, 0)):
    """Return colour and distance, float32, of what rays (..., 3) meet."""
    origin = np.asarray(origin_m, float)
    nearest, kind = np.full(rays.shape[:-1], np.inf), np.zeros(rays.shape[:-1], int)

    def meet(distance, there, number):
        distance = np.where(there & (distance > 1e-6), distance, np.inf)
        kind[distance < nearest] = number
        np.minimum(nearest, distance, out=nearest)

    with np.errstate(divide="ignore", invalid="ignore"):
        for axis, low, high in ((0, -HALF_M, HALF_M), (1, -UP_M, DOWN_M), (2, -HALF_M, HALF_M)):
            along = rays[..., axis]
            wall = np.where(along > 0, high, low)
            meet((wall - origin[axis]) / along, along != 0, axis)
        for number, (x, z, radius) in enumerate(PILLARS):
            away = origin - (x, 0, z)
            square = rays[..., 0] ** 2 + rays[..., 2] ** 2
            half = away[0] * rays[..., 0] + away[2] * rays[..., 2]
            inside = half**2 - square * (away[0] ** 2 + away[2] ** 2 - radius**2)
            meet((-half - np.sqrt(np.maximum(inside, 0))) / square, inside > 0, 3 + number)
        for number, (*place, radius) in enumerate(BALLS):
            away = origin - place
            half = rays @ away
            inside = half**2 - away @ away + radius**2
            meet(-half - np.sqrt(np.maximum(inside, 0)), inside > 0, 20 + number)
    point = origin + rays * nearest[..., None]
    tint = np.sin(kind[..., None] * (1.7, 2.9, 4.1) + (0, 1, 2))
    waves = point @ np.array([[5, 0, -2], [3, 4, 0], [0, 5, 6]])
    return (0.5 + 0.12 * tint + 0.09 * np.sin(waves)).astype(np.float32), nearest.astype(np.float32)


def room_around(height_px):
    """Return the panorama with distance from the room's middle."""
    geometry = Equirectangular().of(2 * height_px, height_px)
    return PanoramaFrame(*look_along(geometry.directions(*pixel_centres(geometry))))


def true_view(geometry, right_deg, down_deg, move_m):
    """Return colour and depth along the axis of a flat view."""
    rays = geometry.directions(*pixel_centres(geometry))
    colour, distance_m = look_along(rays @ turn(right_deg, down_deg).T, move_m)
    return colour, distance_m * rays[..., 2]


def flat_warp(ctx, geometry, right_deg, down_deg, move_m, margin_px=48):
    """Return the view warped from a flat source of the same density with a margin."""
    size = geometry.width_px + 2 * margin_px, geometry.height_px + 2 * margin_px
    wide = Flat(distance_px=geometry.distance_px).of(*size)
    colour, depth_m = true_view(wide, right_deg, down_deg, (0, 0, 0))
    depth_m = depth_m.astype(np.float32)
    lens = (wide.distance_px, wide.distance_px, *wide.centre_px)
    start = Camera(*size, *lens, np.eye(4))
    end = start.moved(turn(right_deg, down_deg).T @ move_m)
    flow_px, target_m = flow_between(start, end, depth_m)
    window = TargetWindow.inside_margin(depth_m.shape, margin_px)
    source = SourceFrame(colour, depth_m)
    return warp_frame(source, flow_px, target_depth_m=target_m, window=window, ctx=ctx)


def psnr_db(made, true, where):
    """Return the PSNR of colours at some pixels."""
    return -10 * np.log10(np.mean((made[where].astype(float) - true[where]) ** 2))
