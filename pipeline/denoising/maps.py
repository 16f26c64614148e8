"""The moments that a metamer is made of, as maps that a network can predict, and light paths.

Beyond Blur (Walton et al. 2021), section 5.3: a network maps a noisy picture "to a moments map,
which can then be turned into a metamer". The maps here are all that our synthesis needs: the colour
that is left when every pool is averaged, and for blocks of 4x4 pixels the deviation that each band
has lost, and the chroma that goes with it. Deviations, for squares of small numbers are badly
scaled for an L2 loss; chroma as a deviation too, since a slope means nothing where luma has none.

The paper says 1 path in the periphery and 32 in the centre, and not how they fall between. In
`Sampling`, by which the networks' pictures were rendered, the exponent falls linearly with the
eccentricity.

Twin of `metamer_of`: gpu.py and weights.comp.glsl. Change both or neither.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.foveation.chain import chain_length, chain_of, select
from pipeline.foveation.noise_plane import noise_plane
from pipeline.foveation.pooled_moments import (
    BLOCK_HALVINGS,
    SMALLEST_VARIANCE,
    WantedMoments,
    wanted_by_blocks,
)
from pipeline.foveation.pooling import Pools
from pipeline.foveation.reference import finished, lost_noise
from pipeline.frame import Floats


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


LEVELS = 5
"""Number of levels of the pyramid, as `MetamerSettings` has it; small pictures have fewer."""
BLOCK_PX = 1 << BLOCK_HALVINGS
MOST_SLOPE = 2.0
"""Bound of chroma on luma: where luma hardly varies, small errors must not grow into colour."""


@dataclass(frozen=True, eq=False)
class MomentMaps:
    """Base and moments that a metamer is made of.

    Parameters
    ----------
    base : ndarray of shape (H, W, 3)
        Averaged colour, encoded R'G'B'; in the fovea the picture.
    deviations : ndarray of shape (h, w, levels * 3)
        Of luma's lost coefficients in each band, by blocks of 4x4 pixels; at least 0.
    slopes : ndarray of shape (h, w, levels, 2)
        Cb and Cr that go with luma.
    """

    base: Floats
    deviations: Floats
    slopes: Floats

    @property
    def levels(self) -> int:
        return int(self.slopes.shape[2])

    def packed(self) -> Floats:
        """Moments of blocks in one array (h, w, levels * 5): deviations, then chroma's."""
        levels = self.levels
        bands = self.deviations.reshape(*self.deviations.shape[:2], levels, 3)
        luma = np.sqrt((bands**2).sum(axis=3) + SMALLEST_VARIANCE)
        chroma = (self.slopes * luma[..., None]).reshape(*luma.shape[:2], 2 * levels)
        return np.concatenate([self.deviations, chroma], axis=2)

    @staticmethod
    def unpacked(base: NDArray[np.floating], values: NDArray[np.floating]) -> MomentMaps:
        """Invert `packed`; what no picture can have is brought into range.

        Parameters
        ----------
        base : ndarray of shape (H, W, 3)
        values : ndarray of shape (ceil(H / 4), ceil(W / 4), levels * 5)
        """
        levels = values.shape[2] // 5
        values = values.astype(np.float64)
        deviations = np.maximum(values[..., : 3 * levels], 0)
        bands = deviations.reshape(*values.shape[:2], levels, 3)
        luma = np.sqrt((bands**2).sum(axis=3) + SMALLEST_VARIANCE)
        chroma = values[..., 3 * levels :].reshape(*values.shape[:2], levels, 2)
        slopes = np.clip(chroma / luma[..., None], -MOST_SLOPE, MOST_SLOPE)
        return MomentMaps(np.clip(base.astype(np.float64), 0, 1), deviations, slopes)

    def wanted(self) -> WantedMoments:
        """Moments that noise has to give; chroma beside luma is left out, and so is its shape."""
        nothing = np.zeros((*self.deviations.shape, 2))
        return WantedMoments(self.deviations**2, self.slopes, nothing)


def maps_of(picture: NDArray[np.floating], pools: Pools, levels: int = LEVELS) -> MomentMaps:
    """Analyse a clean picture (H, W, 3): the maps that a network is to predict.

    `metamer_of` makes of them what `pipeline.foveation.reference.metamer` makes of the picture,
    as long as no slope exceeds `MOST_SLOPE`.
    """
    geometry = pools.geometry
    count = chain_length(geometry.width_px, geometry.height_px)
    levels = min(levels, count)
    lows = chain_of(picture.astype(np.float64), count, wraps=geometry.wraps)
    pooled = select(lows[: levels + 1], pools.lod, wraps=geometry.wraps)
    base = picture + pools.fade()[..., None] * (pooled - picture)
    wanted = wanted_by_blocks(lows, pools, levels)
    slopes = np.clip(wanted.slopes, -MOST_SLOPE, MOST_SLOPE)
    return MomentMaps(base, np.sqrt(wanted.variances), slopes)


def metamer_of(maps: MomentMaps, pools: Pools, seed: int) -> NDArray[np.float32]:
    """Make the metamer of moments: (H, W, 3), encoded R'G'B' in [0, 1]."""
    wraps = pools.geometry.wraps
    plane = noise_plane(maps.base.shape[:2], seed, maps.levels, 1, wraps=wraps)
    noise = lost_noise(maps.wanted(), plane, maps.levels, "follow", wraps=wraps)
    return finished(maps.base, noise.on(maps.base), pools)
