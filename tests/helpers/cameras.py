"""Cameras by their field of view, and the way back from a picture into the world."""

import numpy as np
from numpy.typing import NDArray

from pipeline.camera import UPRIGHT, Camera


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
