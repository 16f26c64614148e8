"""The fixation target: bull's eye and cross hair, after Thaler et al. 2013.

Thaler, Schuetz, Goodale and Gegenfurtner 2013, "What is the best fixation target? The effect of
target shape on stability of fixational eye movements", Vision Research 76: the combination of
bull's eye and cross hair (their shape ABC) gave the least dispersion. Outer disc 0.6 deg, inner
disc and cross hair 0.2 deg; scaled here to the diameter that the protocol asks for.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from protocols.script import Dot

INNER_SHARE = 1 / 3
"""Inner disc and line width as a share of the outer diameter: 0.2 of 0.6 deg."""
_SAMPLES = 8  # per pixel and axis


def target_image(dot: Dot) -> NDArray[np.uint8]:
    """Draw the target, black on the background's grey, with smooth edges.

    Returns
    -------
    ndarray of shape (edge_px, edge_px, 4)
        RGBA with straight alpha.
    """
    size, diameter_px = dot.edge_px, dot.diameter_px
    steps = (np.arange(size * _SAMPLES) + 0.5) / _SAMPLES - size / 2
    x, y = np.meshgrid(steps, steps)
    distance = np.hypot(x, y)
    outer, inner = diameter_px / 2, diameter_px * INNER_SHARE / 2
    disc = distance <= outer
    cross = disc & ((abs(x) <= inner) | (abs(y) <= inner)) & (distance > inner)

    def share(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
        shares: NDArray[np.float64] = mask.reshape(size, _SAMPLES, size, _SAMPLES).mean(axis=(1, 3))
        return shares

    alpha, light = share(disc), share(cross)
    grey = np.divide(light, alpha, out=np.zeros_like(alpha), where=alpha > 0) * dot.grey
    image = np.empty((size, size, 4), np.uint8)
    image[..., :3] = np.rint(grey)[..., None]
    image[..., 3] = np.rint(255 * alpha)
    return image
