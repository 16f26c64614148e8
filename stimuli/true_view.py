"""The true view around the dot, in frames whose periphery a method made ([MI] Fig. 12)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.foveation.geometry import Flat, Geometry, eccentricity_deg, pixel_centres
from protocols.recipes.warped_clips import TrueView

FADE_DEG = 1.0
"""Over so many degrees the true view gives way."""


def true_share(size_px: tuple[int, int], distance_px: float, view: TrueView) -> NDArray[np.float32]:
    """Return how much of each pixel is the true view's: (H, W, 1), 1 within, 0 beyond the fade.

    Parameters
    ----------
    size_px : (width, height)
        Of the clip, which is centred before the eye.
    distance_px : float
        Of the eye, in pixels of the clip.
    """
    geometry = Flat(distance_px=distance_px).of(*size_px)
    dot_px = tuple(
        edge / 2 + distance_px * math.tan(math.radians(angle))
        for edge, angle in zip(size_px, (view.x_deg, view.y_deg), strict=True)
    )
    return share_around(geometry, (dot_px[0], dot_px[1]), view.within_deg)


def share_around(
    geometry: Geometry, gaze_px: tuple[float, float], within_deg: float
) -> NDArray[np.float32]:
    """Return the same around a gaze in pixels: (H, W, 1)."""
    away = eccentricity_deg(geometry, gaze_px, *pixel_centres(geometry))
    way = ((away - within_deg) / FADE_DEG).clip(0, 1)
    share = 1 - way * way * (3 - 2 * way)
    return np.asarray(share[..., None], np.float32)


def with_true_view(
    made: NDArray[np.float32], truth: NDArray[np.float32], share: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Mix a frame with the true one; where the share is 0 or 1, bit for bit one of them."""
    mixed = made + share * (truth - made)
    return np.where(share == 1, truth, np.where(share == 0, made, mixed))
