"""Number of light paths of each pixel: most at the gaze, one in the periphery.

Beyond Blur (Walton et al. 2021), section 5.3, says 1 in the periphery and 32 in the centre, and not
how they fall between. Here the exponent falls linearly with the eccentricity: every so many degrees
the count halves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.foveation.geometry import Geometry, eccentricity_deg, pixel_centres


@dataclass(frozen=True)
class Sampling:
    """Samples by eccentricity.

    Parameters
    ----------
    halvings : int
        At the gaze a pixel has 2 to this power samples, from 0 to 10; far away it has one.
    near_deg, far_deg : float
        Up to the first a pixel has most, from the second on one.

    Raises
    ------
    InputError
        If a number is out of range.
    """

    halvings: int = 5
    near_deg: float = 2.0
    far_deg: float = 16.0

    def __post_init__(self) -> None:
        if not (isinstance(self.halvings, int) and 0 <= self.halvings <= 10):
            raise InputError(
                f"halvings of samples must be a whole number in 0..10 (got {self.halvings!r})"
            )
        if not 0 <= self.near_deg < self.far_deg < math.inf:
            raise InputError(
                "samples must fall between two angles, near_deg below far_deg"
                f" (got {self.near_deg} and {self.far_deg})"
            )

    def exponents(self, geometry: Geometry, gaze_px: tuple[float, float]) -> NDArray[np.intp]:
        """Powers of two, from 0 to `halvings`: (H, W)."""
        away_deg = eccentricity_deg(geometry, gaze_px, *pixel_centres(geometry))
        share = (self.far_deg - away_deg) / (self.far_deg - self.near_deg)
        return np.rint(self.halvings * np.clip(share, 0, 1)).astype(np.intp)

    def counts(self, geometry: Geometry, gaze_px: tuple[float, float]) -> NDArray[np.intp]:
        """Samples of each pixel: (H, W)."""
        return np.left_shift(1, self.exponents(geometry, gaze_px))


def composed(renders: NDArray[np.floating], exponents: NDArray[np.intp]) -> NDArray[np.float32]:
    """Take each pixel from the picture that has its number of samples.

    Pixels of a path tracer share no samples, so this is what tracing each pixel's own number of
    paths gives.

    Parameters
    ----------
    renders : ndarray of shape (N, H, W, 3)
        With 1, 2, 4, ... samples a pixel.
    exponents : ndarray of int, shape (H, W)
        Below N.
    """
    rows, columns = np.indices(exponents.shape)
    return np.asarray(renders[exponents, rows, columns], np.float32)
