"""Flat views out of a panorama: what an eye in its middle sees on a flat screen.

Directions are degrees right of and below the panorama's middle, as gazes are given.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.foveation.geometry import Equirectangular, Flat, FlatGeometry
from pipeline.foveation.panorama import over_poles

SCORED_DEG = 90.0
"""Width and height of the view in which panoramas are scored."""
_MARGIN = 4  # pixels beyond the border that a cubic reads, and some
_MOST_SAMPLES = 16  # per edge of a pixel


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
    around = Equirectangular().of(width, height)
    finest = math.radians(1) * geometry.distance_px  # px per degree in the middle: the least
    samples = min(max(1, math.ceil(width / 360 / finest - 0.01)), _MOST_SAMPLES)
    padded = _padded(np.asarray(panorama, np.float32))
    turned = turn(right_deg, down_deg)
    total = np.zeros((geometry.height_px, geometry.width_px, 3), np.float64)
    inside = (np.arange(samples) + 0.5) / samples
    columns = np.arange(geometry.width_px)[None, :]
    rows = np.arange(geometry.height_px)[:, None]
    for down in inside:
        for right in inside:
            rays = geometry.directions(columns + right, rows + down) @ turned.T
            x, y = around.positions(rays)
            # To indices of the padded array, whose pixels' centres are whole numbers.
            x, y = x - 0.5 + _MARGIN, y - 0.5 + _MARGIN
            total += cv2.remap(
                padded, x.astype(np.float32), y.astype(np.float32), cv2.INTER_CUBIC
            ).reshape(total.shape)
    return np.asarray(np.clip(total / samples**2, 0, 1), np.float32)


def scored_view(panorama_px: tuple[int, int]) -> FlatGeometry:
    """Return the view in which a panorama of (width, height) is scored.

    Square, `SCORED_DEG` wide; a pixel in its middle is as large as the panorama's at the horizon.
    """
    width_px, height_px = panorama_px
    Equirectangular().of(width_px, height_px)
    distance_px = width_px / (2 * math.pi)
    edge_px = max(1, round(2 * distance_px * math.tan(math.radians(SCORED_DEG / 2))))
    return Flat(width_deg=SCORED_DEG).of(edge_px, edge_px)


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


def turn(right_deg: float, down_deg: float) -> NDArray[np.float64]:
    """The rotation that takes (0, 0, 1) to that direction; level stays level."""
    right, down = math.radians(right_deg), math.radians(down_deg)
    nod = np.array(
        [[1, 0, 0], [0, math.cos(down), math.sin(down)], [0, -math.sin(down), math.cos(down)]]
    )
    swing = np.array(
        [[math.cos(right), 0, math.sin(right)], [0, 1, 0], [-math.sin(right), 0, math.cos(right)]]
    )
    return np.asarray(swing @ nod)


def _padded(panorama: NDArray[np.float32]) -> NDArray[np.float32]:
    """Go on past the sides, and past the poles where the other meridian comes back."""
    tall = over_poles(panorama, _MARGIN)
    return np.pad(tall, ((0, 0), (_MARGIN, _MARGIN), (0, 0)), mode="wrap")
