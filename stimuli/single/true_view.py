"""The true view around the dot, in frames whose periphery a method made ([MI] Fig. 12)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.foveation.geometry import Flat, share_around
from protocols.recipes.warped_clips import TrueView


def true_share(size_px: tuple[int, int], distance_px: float, view: TrueView) -> NDArray[np.float32]:
    """Return the true view's share of each pixel: (H, W, 1), 1 within, 0 beyond the fade.

    Parameters
    ----------
    size_px : (width, height)
        Of the clip, which is centred before the eye.
    distance_px : float
        Of the eye, in pixels of the clip.
    """
    geometry = Flat(distance_px=distance_px).of(*size_px)
    return share_around(geometry, geometry.place_px(view.x_deg, view.y_deg), view.within_deg)[
        ..., None
    ]


def with_true_view(
    made: NDArray[np.float32], truth: NDArray[np.float32], share: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Mix a frame with the true one; where the share is 0 or 1, bit for bit one of them."""
    mixed = made + share * (truth - made)
    return np.where(share == 1, truth, np.where(share == 0, made, mixed))
