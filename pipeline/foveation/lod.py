"""The level of detail at which a chain of halvings pools as widely as the eye does.

n halvings and n doublings average with the variance ``v_n = HALVED_VARIANCE * (4^n - 1)``, in
pixels squared along each axis. A mixture of two neighbouring levels, of shares 1 - a and a, has the
variance ``(1 - a) v_n + a v_(n+1)``; so ``n + a`` follows from the variance that is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.features.reference import fitted_kernels
from pipeline.foveation.geometry import Geometry, check_gaze, eccentricity_deg, pixel_centres
from pipeline.foveation.pooling import Pooling
from pipeline.frame import Floats

FADE_SHARE = 0.25
"""Of the fovea's radius: over it what is changed fades in."""


def halving_variance() -> float:
    """Variance of the pyramid's low-pass along an axis, pixels squared."""
    low = fitted_kernels().low.sum(axis=0)
    return float((low * (np.arange(4) - 1.5) ** 2).sum())


# The low-pass, and doubling by 3/4 and 1/4 (variance 3/16 of a coarse pixel, 3/4 of a fine one).
HALVED_VARIANCE = halving_variance() / 3 + 0.25


def lod_of(sigma_px: Floats) -> Floats:
    """Level of detail of pools with the deviation `sigma_px`, in pixels of the finest level."""
    variance = np.square(sigma_px) / HALVED_VARIANCE
    level = np.floor(0.5 * np.log2(variance + 1))
    power = 4.0**level
    return np.asarray(level + (variance - (power - 1)) / (3 * power))


@dataclass(frozen=True)
class Pools:
    """The pools of one picture under one gaze."""

    geometry: Geometry
    gaze_px: tuple[float, float]
    pooling: Pooling

    def __post_init__(self) -> None:
        object.__setattr__(self, "gaze_px", check_gaze(self.geometry, self.gaze_px))

    def eccentricity_deg(self, halvings: int = 0) -> Floats:
        """Eccentricity, degrees, at the texels of the picture halved so often: (h, w)."""
        return eccentricity_deg(
            self.geometry, self.gaze_px, *pixel_centres(self.geometry, halvings)
        )

    def sigma_px(self, halvings: int = 0) -> Floats:
        """Deviation of the pools at these texels, in pixels of the picture: (h, w)."""
        density = self.geometry.px_per_deg(*pixel_centres(self.geometry, halvings))
        return np.asarray(self.pooling.sigma_deg(self.eccentricity_deg(halvings)) * density)

    def lod(self, halvings: int = 0, level: int = 0) -> Floats:
        """Level of detail at these texels, in pyramid level `level`'s own chain: (h, w)."""
        return lod_of(self.sigma_px(halvings) / (1 << level))

    def fade(self) -> Floats:
        """Share of the change at each pixel: 0 in the fovea, 1 beyond its border: (H, W)."""
        fovea_deg = self.pooling.fovea_deg
        away_deg = self.eccentricity_deg() - fovea_deg
        if fovea_deg == 0:
            return np.asarray((away_deg > 0).astype(np.float64))
        return np.asarray(np.clip(away_deg / (FADE_SHARE * fovea_deg), 0, 1))
