"""Noise that lies on a texture, for each level of its pyramid.

A level's noise is fixed at its coefficients: whatever pixel reads it, at whatever level of detail,
finds the same. So it can hold no share of other levels, as mixed noise does (noise/gains.py): each
band of each level has noise of its own. Bands overlap, and energies of independent noise add up:
`overlap` says what a band measures of another, and `gains` what follows for the weights.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from pipeline.foveation.noise_plane import GRAIN, MOST_STEPS, grained
from pipeline.frame import Floats, Ints, check_seed
from pipeline.noise.gains import LAGS, UNSEEN_VARIANCE
from pipeline.noise.tile import NoiseBands, look_up, midway, split, unit, white_steps
from pipeline.textures.bake import Layout

SignedBytes = NDArray[np.int8]

TILE = 256  # coefficients: beyond it noise repeats itself
NOISE_PER_TEXEL = 2  # pixels of noise at a level's texel; a tile has two texels a pixel
REACH = 2  # levels, up and down, of which a band measures something
STAGES = 3  # how many halvings off the pixels a level is: 0, 1, more
LEAST_GAIN, MOST_GAIN = 0.25, 2.0
STEPS = 2  # of the fixed-point iteration of `gains`


@dataclass(frozen=True, eq=False)
class SurfaceNoise:
    """The noise of one seed for one texture.

    `tiles`: (rows, columns, 3 bands) in steps of `GRAIN`, periodic, four texels per coefficient
    along each axis. `tile_of_level`: which of them a level reads, from `offset_px` (levels, 2) on,
    in pixels of noise. `lag_correlation` (3, 4): of neighbouring texels.
    """

    tiles: tuple[SignedBytes, ...]
    tile_of_level: tuple[int, ...]
    offset_px: Ints
    lag_correlation: NDArray[np.float32]

    def at(self, level: int, place_px: Floats) -> Floats:
        """A level's noise, of unit variance: (H, W, 3 bands).

        Parameters
        ----------
        place_px : ndarray of shape (H, W, 2)
            x and y on the texture, in texels of its finest resolution.
        """
        anchor = place_px * (NOISE_PER_TEXEL / 2**level) + self.offset_px[level]
        tile = GRAIN * self.tiles[self.tile_of_level[level]].astype(np.float64)
        bands = NoiseBands(tile[None, None], self.lag_correlation[None])
        return look_up(bands, 0, anchor)[..., 0]


@lru_cache(maxsize=2)
def surface_noise(seed: int, layout: Layout) -> SurfaceNoise:
    """Make the noise of one seed.

    Where the texture goes round, a level's noise does: its period divides the texture's width.
    """
    check_seed(seed)
    levels = range(layout.halvings)
    widths = [_period(layout.size(k)[1]) if layout.wraps else TILE for k in levels]
    kinds = sorted(set(widths), reverse=True)
    tiles = tuple(_tile(seed, width) for width in kinds)
    rng = np.random.Generator(np.random.Philox(key=seed))
    raw = rng.bit_generator.random_raw(2 * layout.halvings)
    offset = (raw % np.uint64(NOISE_PER_TEXEL * TILE)).astype(np.int64).reshape(-1, 2)
    largest = GRAIN * tiles[kinds.index(max(kinds))].astype(np.float64)
    lags = [
        (largest * np.roll(largest, (-down, -right), (0, 1))).mean(axis=(0, 1))
        for down, right in LAGS
    ]
    correlation = np.stack(lags, axis=-1) / (largest**2).mean(axis=(0, 1))[:, None]
    return SurfaceNoise(
        tiles, tuple(kinds.index(w) for w in widths), offset, correlation.astype(np.float32)
    )


def _period(columns: int) -> int:
    """Largest divisor of a level's width that is no larger than a tile."""
    return max(edge for edge in range(1, TILE + 1) if columns % edge == 0)


def _tile(seed: int, columns: int) -> SignedBytes:
    """Noise of a level, `TILE` rows of so many coefficients: (4 * TILE, 4 * columns, 3)."""
    # The second level of a pyramid, brought up once, and texels between: four a coefficient.
    copies = -(-8 // columns)  # filters reach farther than a tiny tile: it is repeated first
    white = white_steps(seed, (NOISE_PER_TEXEL * TILE, NOISE_PER_TEXEL * columns), 3)
    bands = split(np.tile(white, (1, 1, copies)), 2)[1]
    own = np.stack([unit(bands[band, band, :, : NOISE_PER_TEXEL * columns]) for band in range(3)])
    dense = midway(midway(own, 1), 2)
    steps = np.rint(grained(np.moveaxis(dense, 0, -1)).astype(np.float64) / GRAIN)
    return np.ascontiguousarray(steps.clip(-MOST_STEPS, MOST_STEPS), np.int8)


@lru_cache(maxsize=1)
def fitted_overlap() -> Floats:
    """Overlap of bands that `benchmarks/fits/fit_overlap.py` wrote: (STAGES, 2 * REACH + 1, 3, 3).

    ``[j, REACH + d, b, c]``: the variance that band b of a level measures of unit noise in band c
    of the level that is d coarser, where pixels are j halvings finer than the level: what a pyramid
    finds of a level changes with its distance from the pixels. From the last j on it stays.
    """
    text = resources.files("pipeline.textures").joinpath("overlap.json").read_text("utf-8")
    return np.array(json.loads(text)["overlap"])


def gains(variances: Floats, rho: Floats) -> Floats:
    """Factors on deviations, so that bands measure what they are asked for.

    Parameters
    ----------
    variances : ndarray of shape (levels, 3, ...)
        Asked for, at least 0.
    rho : ndarray of shape (...)
        Level at which texels are as large as pixels.
    """
    overlap, levels = fitted_overlap(), len(variances)
    given = variances
    for _ in range(STEPS):
        measured = np.zeros(variances.shape)
        for level in range(levels):
            finer = np.clip(level - rho, 0, STAGES - 1)
            for stage in range(STAGES):
                share = np.maximum(1 - np.abs(finer - stage), 0)
                for d in range(-REACH, REACH + 1):
                    if 0 <= level + d < levels:
                        form = overlap[stage, REACH + d]
                        measured[level] += share * np.tensordot(form, given[level + d], 1)
        given = given * (variances + UNSEEN_VARIANCE) / (measured + UNSEEN_VARIANCE)
    square = np.divide(given, variances, out=np.ones_like(given), where=variances > 0)
    return np.asarray(np.sqrt(np.clip(square, LEAST_GAIN**2, MOST_GAIN**2)))
