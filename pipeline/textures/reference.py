"""Colour of a surface from its baked texture: what is lost to pooling comes back as noise.

Walton et al. 2021 ("Beyond Blur"), section 5.2, with what it leaves open settled in
docs/textures.md. A pixel covers ``2^rho`` texels along an edge, and its pool ``2^eta`` pixels. The
base is the texture at level of detail ``rho + eta``. Lost are bands of pyramid levels from rho on:
each gets noise of the moments that it has at ``rho + eta``.

Twin: shaderlib/baked.glsl. Change both or neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.foveation.pooled_moments import SMALLEST_VARIANCE, added, along_luma
from pipeline.foveation.reference import rgb_slopes
from pipeline.frame import Bools, Floats
from pipeline.textures.bake import BakedTexture
from pipeline.textures.surface_noise import SurfaceNoise, gains


@dataclass(frozen=True, eq=False)
class Fragments:
    """Fragments to draw; arrays of one shape (H, W), `place_px` (H, W, 2).

    `place_px`: x and y on the texture, in its finest texels. `rho`: logarithm to base 2 of texels
    per pixel. `eta`: level of detail of the pool, in pixels; 0: nothing is pooled.
    """

    place_px: Floats
    rho: Floats
    eta: Floats

    def where(self, chosen: Bools) -> Fragments:
        """Chosen fragments, in one row: arrays (N)."""
        return Fragments(self.place_px[chosen], self.rho[chosen], self.eta[chosen])


@dataclass(frozen=True, eq=False)
class ShadedColour:
    """`base` and `noise` (H, W, 3): R'G'B', and what is added, within the display."""

    base: Floats
    noise: Floats


def shade(baked: BakedTexture, fragments: Fragments, noise: SurfaceNoise) -> ShadedColour:
    """Colour of each fragment (H, W), in two parts: its base, and the noise on it."""
    count = baked.layout.halvings
    lod = np.clip(fragments.rho + fragments.eta, 0, count)
    base = read_mips(baked.colour, 0, lod, fragments.place_px, wraps=baked.layout.wraps) / 255
    lost = [lost_energy(level, fragments.rho, lod) for level in range(count)]
    variances = np.zeros((count, 3, *lod.shape))
    slopes = np.zeros((count, 2, *lod.shape))
    for level in range(count):
        first = level + 1
        found = read_mips(
            baked.moments[level], first, lod, fragments.place_px, wraps=baked.layout.wraps
        )
        square, mean, cross = np.split(found, (3, 6), axis=-1)
        variance = np.maximum(square - mean**2, 0) * lost[level][..., None]
        variances[level] = np.moveaxis(variance, -1, 0)
        energy = square.sum(axis=-1, keepdims=True) + SMALLEST_VARIANCE
        slopes[level] = np.moveaxis(cross / energy, -1, 0)
    weights = np.sqrt(variances) * gains(variances, fragments.rho)
    along = rgb_slopes(np.moveaxis(slopes, 1, -1))
    # Noise is independent by level and band.
    squares = (weights**2).sum(axis=1)[..., None]
    luma, cross, variance = (np.sum(squares * along**power, axis=0) for power in range(3))
    rgb = np.zeros((*lod.shape, 3))
    for level in np.flatnonzero([energy.any() for energy in lost]).tolist():
        own = np.moveaxis(noise.at(level, fragments.place_px), -1, 0)
        rgb += (weights[level] * own).sum(axis=0)[..., None] * along[level]
    together = along_luma(cross, variance, luma)
    return ShadedColour(base, added(base, rgb, np.sqrt(variance), along=together) - base)


def lost_energy(level: int, rho: NDArray[np.floating], lod: NDArray[np.floating]) -> Floats:
    """Share of a level's energy that a pixel should show and the base lacks.

    Between two resolutions a share of the coefficients is there: ``level + 1 - lod``, from 0 to 1.
    """
    shown, kept = (np.clip(level + 1 - at, 0, 1) for at in (rho, lod))
    return np.asarray(np.maximum(shown**2 - kept**2, 0))


def read_mips(
    mips: Sequence[NDArray[np.generic]],
    first: int,
    lod: Floats,
    place_px: Floats,
    *,
    wraps: bool,
) -> Floats:
    """Read halvings `first`, `first` + 1, ... of a texture trilinearly: (H, W, channels)."""
    lod = np.clip(lod, first, first + len(mips) - 1)
    finer = np.minimum(np.floor(lod).astype(int), first + len(mips) - 2) if len(mips) > 1 else None
    result = np.zeros((*lod.shape, mips[0].shape[2]))
    if finer is None:
        return read_linear(mips[0], place_px / 2.0**first, wraps=wraps)
    for index in np.unique(finer).tolist():
        here = finer == index
        share = (lod[here] - index)[:, None]
        fine, coarse = (
            read_linear(mips[n - first], place_px[here] / 2.0**n, wraps=wraps)
            for n in (index, index + 1)
        )
        result[here] = (1 - share) * fine + share * coarse
    return result


def read_linear(image: NDArray[np.generic], place: Floats, *, wraps: bool) -> Floats:
    """Read (H, W, channels) between its texels, at x and y (..., 2) in texels."""
    corner = np.floor(place - 0.5)
    part = place - 0.5 - corner
    found = np.zeros((*place.shape[:-1], image.shape[2]))
    for rows, columns, weight in texels(corner.astype(int), part, image.shape[:2], wraps=wraps):
        found += weight[..., None] * image[rows, columns].astype(np.float64)
    return found


def texels(
    corner: NDArray[np.int_], part: Floats, size: tuple[int, ...], *, wraps: bool
) -> list[tuple[NDArray[np.int_], NDArray[np.int_], Floats]]:
    """The four texels of a linear look-up: rows, columns and weights."""
    height, width = size
    found = []
    for down in (0, 1):
        rows = np.clip(corner[..., 1] + down, 0, height - 1)
        for right in (0, 1):
            columns = corner[..., 0] + right
            columns = columns % width if wraps else np.clip(columns, 0, width - 1)
            y, x = (
                part[..., axis] if step else 1 - part[..., axis]
                for axis, step in ((1, down), (0, right))
            )
            found.append((rows, columns, y * x))
    return found
