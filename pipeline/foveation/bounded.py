"""Noise kept on the display.

Where a pool nearly reaches an end of the display, normal noise would leave it. Clipped, it takes
the mean colour with it: a page of text would turn grey, a yellow one pale. So red, green and blue
get another marginal there: the normal distribution function of normal noise, ``Phi(mu + s z)``. It
lies within the display, and its mean is ``Phi(mu / sqrt(1 + s^2))``, whatever s: so mu keeps the
base's colour exactly. With s it goes from normal noise to the two ends without anything between, as
print has it. Where a pool has few colours, its own ends stand for the display's.

Twin: shaderlib/bounded.glsl. Change both or neither.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtr, ndtri

from pipeline.foveation.pooled_moments import SMALLEST_VARIANCE
from pipeline.frame import Floats

FREE, BOUND = 2.5, 1.5
"""Deviations from the nearest end: noise is normal beyond the first, bound within
the second, and mixed between. Wholly bound, pale skies would lose."""
LEAST_VALUE = 1e-4
"""Of a base, from either end: where the normal distribution function is inverted."""
MOST_FILLED = 0.98
"""Of the variance of black and white without grey."""
STEEPEST = 4.0
"""Steeper, the rounding of noise to half floats would show."""
SHARPENED = 0.15
"""Share of the variance that is left out at most, for the bend makes fine detail of coarse."""
EXCESS = -0.3
"""Excess kurtosis of noise, -.5 where its finest band is strongest, -.1 where coarse ones are. The
mean is mended to first order in it (Edgeworth)."""

FARTHEST = 8.0
"""Deviations from the base that noise leads to at most, bound as free. Farther, a nearly white
cloud had black specks."""

BOUND_CONSTANTS = {
    "FREE": FREE,
    "BOUND": BOUND,
    "LEAST_VALUE": LEAST_VALUE,
    "MOST_FILLED": MOST_FILLED,
    "STEEPEST": STEEPEST,
    "SHARPENED": SHARPENED,
    "EXCESS": EXCESS,
    "FARTHEST": FARTHEST,
    "SMALLEST_VARIANCE": SMALLEST_VARIANCE,
}
"""Constants that bounded.glsl is compiled with."""


def added(
    base: Floats,
    noise: Floats,
    deviation: Floats,
    below: Floats | None = None,
    above: Floats | None = None,
) -> Floats:
    """Add noise to R'G'B' so that it stays within its ends, and keeps its mean.

    Where there is no noise, the base stays as it is.

    Parameters
    ----------
    base, noise, deviation : ndarray of shape (..., 3)
        Of red, green and blue; noise is normal, of that deviation.
    below, above : ndarray of shape (..., 3), optional
        How far from the base noise may lead, beside `FARTHEST`.
    """
    deviation = np.sqrt(deviation**2 + SMALLEST_VARIANCE)
    reach = FARTHEST * deviation
    low = np.maximum(base - (reach if below is None else np.minimum(below, reach)), 0)
    width = np.minimum(base + (reach if above is None else np.minimum(above, reach)), 1) - low
    place, spread = (base - low) / width, deviation / width
    room = (np.minimum(place, 1 - place) / spread).min(axis=-1, keepdims=True)
    share = np.clip((FREE - room) / (FREE - BOUND), 0, 1)
    place = np.clip(place, LEAST_VALUE, 1 - LEAST_VALUE)
    filled = np.minimum(spread**2 / (place * (1 - place)), MOST_FILLED)
    mean = ndtri(place)
    slope = slope_of(filled * (1 - SHARPENED * filled), place, mean)
    wide = 1 + slope**2
    mean = mean - EXCESS / 24 * (slope**2 / wide) ** 2 * mean * (3 - mean**2)
    bent = low + width * ndtr(mean * np.sqrt(wide) + slope * noise / deviation)
    free = base + noise
    changed = np.clip(free + share * (bent - free), 0, 1)
    return np.where((noise != 0).any(axis=-1, keepdims=True), changed, base)


def slope_of(filled: Floats, place: Floats, mean: Floats) -> Floats:
    """s, for a share of the variance ``place (1 - place)``, and `mean` with ``Phi(mean) = place``.

    Mixed of what holds for little variance and for nearly all of it; from .07 to .93 the variance
    comes out within a tenth, nearer to the ends up to twice too large.
    """
    density = np.exp(-0.5 * mean**2) / math.sqrt(2 * math.pi)
    most = place * (1 - place)
    little, nearly_all = np.sqrt(most) / density, density / (math.sqrt(math.pi) * most)
    found = np.sqrt(filled) * (little + filled / (1 - filled) * nearly_all)
    return np.minimum(found, STEEPEST)
