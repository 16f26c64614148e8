"""Flat views out of a panorama: what an eye in its middle sees on a flat screen.

Directions are degrees right of and below the panorama's middle, as gazes are given. Noise of a
view that turns lies on directions: `anchored_shift_px`.

Twin: `ViewPass` in panorama_gpu.py. Change both or neither.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.foveation.geometry import Equirectangular, Flat, FlatGeometry, pixel_centres
from pipeline.foveation.noise_plane import tile_edge
from pipeline.foveation.panorama import seen_in
from pipeline.frame import Floats

SCORED_DEG = 90.0
"""Width and height of the view in which panoramas are scored."""
MOST_SAMPLES = 16  # per edge of a pixel
NOISE_BELT_DEG = 45.0
"""Up to this latitude noise lies along meridians and parallels, beyond it around the pole."""
BELT_STRETCH = 0.85
"""Pixels of noise over those of the view along the equator: so at 45 degrees it is 1.2."""


def flat_view(
    panorama: NDArray[np.floating],
    geometry: FlatGeometry,
    *,
    right_deg: float = 0.0,
    down_deg: float = 0.0,
) -> NDArray[np.float32]:
    """Look at a place of a panorama through a flat picture.

    Parameters
    ----------
    panorama : ndarray of shape (h, 2 h, 3)
        Equirectangular, encoded R'G'B' in [0, 1].
    geometry : FlatGeometry
        Of the view: its size in pixels, and how far the eye is.
    right_deg, down_deg : float
        Where the normal of the view points: longitude and latitude from the panorama's middle.

    Returns
    -------
    ndarray of float32, shape (H, W, 3)
        In [0, 1]. Cubic between pixels; where the view is coarser than the panorama, the mean of
        as many samples as it takes.

    Raises
    ------
    InputError
        If the panorama is not 2:1.
    """
    height, width = panorama.shape[:2]
    Equirectangular().of(width, height)
    samples = samples_of(geometry, width)
    turned = turn(right_deg, down_deg)
    total = np.zeros((geometry.height_px, geometry.width_px, 3), np.float64)
    inside = (np.arange(samples) + 0.5) / samples
    columns = np.arange(geometry.width_px)[None, :]
    rows = np.arange(geometry.height_px)[:, None]
    for down in inside:
        for right in inside:
            rays = geometry.directions(columns + right, rows + down) @ turned.T
            total += seen_in(panorama, rays)
    return np.asarray(np.clip(total / samples**2, 0, 1), np.float32)


def samples_of(geometry: FlatGeometry, panorama_width_px: int) -> int:
    """Number of samples of a panorama along each edge of a view's pixel."""
    finest = math.radians(1) * geometry.distance_px  # px per degree in the middle: the least
    return min(max(1, math.ceil(panorama_width_px / 360 / finest - 0.01)), MOST_SAMPLES)


def anchored_shift_px(
    geometry: FlatGeometry, *, right_deg: float = 0.0, down_deg: float = 0.0
) -> Floats:
    """Shift of each pixel of a view to noise that lies on directions: `noise_shift_px`, (H, W, 2).

    At 45 degrees of latitude, where what lies along parallels meets what lies around a pole, noise
    changes from one pixel to the next.
    """
    x, y = np.broadcast_arrays(*pixel_centres(geometry))
    rays = geometry.directions(x, y) @ turn(right_deg, down_deg).T
    across, down, ahead = np.moveaxis(rays, -1, 0)
    belt = (
        belt_px(geometry) * np.arctan2(across, ahead),
        geometry.distance_px * np.arcsin(np.clip(down, -1, 1)),
    )
    scale = 2 * geometry.distance_px / (1 + np.abs(down))
    cap = (scale * across, scale * np.sign(down) * ahead)
    in_belt = np.abs(down) <= math.sin(math.radians(NOISE_BELT_DEG))
    place = [np.where(in_belt, *both) for both in zip(belt, cap, strict=True)]
    return np.stack([x - place[0], y - place[1]], axis=-1)


def belt_px(geometry: FlatGeometry) -> float:
    """Pixels of noise for a radian of longitude: whole tiles go once round."""
    edge = tile_edge(geometry.height_px, geometry.width_px)
    tiles = round(BELT_STRETCH * 2 * math.pi * geometry.distance_px / edge)
    return max(1, tiles) * edge / (2 * math.pi)


def scored_view(panorama_px: tuple[int, int]) -> FlatGeometry:
    """Return the view in which a panorama of (width, height) is scored.

    Square, `SCORED_DEG` wide; a pixel in its middle is as large as the panorama's at the horizon.
    """
    width_px, height_px = panorama_px
    Equirectangular().of(width_px, height_px)
    return square_view(width_px, SCORED_DEG)


def square_view(panorama_width_px: int, view_deg: float) -> FlatGeometry:
    """Return a square view whose middle has pixels as large as the panorama's at the horizon."""
    distance_px = panorama_width_px / (2 * math.pi)
    edge_px = max(1, round(2 * distance_px * math.tan(math.radians(view_deg / 2))))
    return Flat(width_deg=view_deg).of(edge_px, edge_px)


def around_gaze(
    panorama: NDArray[np.floating], gaze_px: tuple[float, float]
) -> NDArray[np.float32]:
    """Return the view in which a panorama is scored, the gaze in its middle."""
    height, width = panorama.shape[:2]
    return flat_view(
        panorama,
        scored_view((width, height)),
        right_deg=360 * (gaze_px[0] / width - 0.5),
        down_deg=180 * (gaze_px[1] / height - 0.5),
    )


def turn(right_deg: float, down_deg: float) -> Floats:
    """The rotation that takes (0, 0, 1) to that direction; level stays level."""
    right, down = math.radians(right_deg), math.radians(down_deg)
    nod = np.array(
        [[1, 0, 0], [0, math.cos(down), math.sin(down)], [0, -math.sin(down), math.cos(down)]]
    )
    swing = np.array(
        [[math.cos(right), 0, math.sin(right)], [0, 1, 0], [-math.sin(right), 0, math.cos(right)]]
    )
    return np.asarray(swing @ nod)
