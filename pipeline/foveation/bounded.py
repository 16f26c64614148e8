"""Noise kept on the display.

Where a pool nearly reaches black or white, normal noise would leave the display. Clipped, it takes
the mean colour with it: a page of text would turn grey. So luma gets another marginal there: the
normal distribution function of normal noise, ``Phi(mu + s z)``. It lies between black and white,
and its mean is ``Phi(mu / sqrt(1 + s^2))``, whatever s: so mu keeps the base's luma exactly. With
s it goes from normal noise to black and white without grey, as print has it.

What chroma would then leave the display by, it gives up at that luma.

Twin: shaderlib/bounded.glsl. Change both or neither.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from pipeline.colour import RGB_FROM_YCBCR, ycbcr_from_rgb
from pipeline.foveation.moments import SMALLEST_VARIANCE

Floats = NDArray[np.float64]

FREE, BOUND = 2.5, 0.5
"""Deviations from the nearer end of the display: noise is normal beyond the first, bound within
the second, and mixed between. Wholly bound, pale skies would lose."""
LEAST_LUMA = 1e-4
"""Of a base, from either end: where the normal distribution function is inverted."""
MOST_FILLED = 0.98
"""Of the variance of black and white without grey."""
STEEPEST = 4.0
"""Steeper, the rounding of noise to half floats would show."""
SHARPENED = 0.15
"""Share of the variance that is left out at most, for the bend makes fine detail of coarse."""

BOUND_CONSTANTS = {
    "FREE": FREE,
    "BOUND": BOUND,
    "LEAST_LUMA": LEAST_LUMA,
    "MOST_FILLED": MOST_FILLED,
    "STEEPEST": STEEPEST,
    "SHARPENED": SHARPENED,
    "SMALLEST_VARIANCE": SMALLEST_VARIANCE,
}
"""What bounded.glsl is compiled with."""


def added(base: Floats, ycc: Floats, deviation: Floats) -> Floats:
    """Add noise to R'G'B' (H, W, 3) so that all of it stays on the display.

    Where there is no noise, the base stays as it is.

    Parameters
    ----------
    ycc : ndarray of shape (H, W, 3)
        Noise, Y'CbCr; luma's is normal.
    deviation : ndarray of shape (H, W)
        Of luma's noise there.
    """
    luma, chroma = np.split(ycbcr_from_rgb(base).astype(np.float64), (1,), axis=-1)
    noisy = bounded(luma[..., 0], ycc[..., 0], deviation)[..., None]
    changed = in_gamut(noisy, chroma + ycc[..., 1:])
    return np.where((ycc != 0).any(axis=-1, keepdims=True), changed, base)


def bounded(base: Floats, noise: Floats, deviation: Floats) -> Floats:
    """Luma with its noise, from 0 to 1; of normal noise the mean is `base`. Arrays of one shape."""
    deviation = np.sqrt(deviation**2 + SMALLEST_VARIANCE)
    room = np.minimum(base, 1 - base) / deviation
    share = np.clip((FREE - room) / (FREE - BOUND), 0, 1)
    luma = np.clip(base, LEAST_LUMA, 1 - LEAST_LUMA)
    most = luma * (1 - luma)
    filled = np.minimum(deviation**2 / most, MOST_FILLED)
    mean = ndtri(luma)
    slope = slope_of(filled * (1 - SHARPENED * filled), luma, mean)
    bent = ndtr(mean * np.sqrt(1 + slope**2) + slope * noise / deviation)
    free = base + noise
    return np.asarray(np.clip(free + share * (bent - free), 0, 1))


def slope_of(filled: Floats, luma: Floats, mean: Floats) -> Floats:
    """s, for a share of the variance ``luma (1 - luma)``, and `mean` with ``Phi(mean) = luma``.

    Mixed of what holds for little variance and for nearly all of it; for luma from .07 to .93 the
    variance comes out within a tenth, nearer to the ends up to twice too large.
    """
    density = np.exp(-0.5 * mean**2) / math.sqrt(2 * math.pi)
    most = luma * (1 - luma)
    little, nearly_all = np.sqrt(most) / density, density / (math.sqrt(math.pi) * most)
    found = np.sqrt(filled) * (little + filled / (1 - filled) * nearly_all)
    return np.minimum(found, STEEPEST)


def in_gamut(luma: Floats, chroma: Floats) -> Floats:
    """R'G'B' of a luma in [0, 1], (..., 1), and of as much chroma (..., 2) as it can have."""
    away = chroma @ RGB_FROM_YCBCR[:, 1:].T
    room = np.where(away > 0, 1 - luma, luma)
    share = np.divide(room, np.abs(away), out=np.ones_like(away), where=np.abs(away) > room)
    return np.asarray(luma + share.min(axis=-1, keepdims=True) * away)
