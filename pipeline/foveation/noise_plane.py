"""The fills' noise, laid over a whole picture.

A picture gets a tile as large as itself, up to `LARGEST_TILE`: on any even texture one would see
the tile of fills, 256 px, repeat itself. A panorama gets noise for all of it, without a seam.

Noise is kept in steps of `GRAIN`, so that a byte holds it: what is added to a picture last waits
for memory, and noise as coarse as that tells no more.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.frame import Floats
from pipeline.noise.gains import fitted_mixing
from pipeline.noise.tile import (
    TILE,
    NoiseBands,
    Steps,
    look_up,
    midway,
    mixed,
    mixed_bands,
    split,
    white_steps,
)

Halves = NDArray[np.float16]
"""Steps of `GRAIN` are exact in it."""

LARGEST_TILE = 1024  # edge, pixels: beyond it memory would grow and little would be gained
GRAIN = 2.0**-4  # step of the noise, deviations
MOST_STEPS = 127  # to either side: 8 deviations


def tile_edge(height: int, width: int) -> int:
    """Return the edge of the tile for a picture: a power of two, in pixels."""
    edge = TILE
    while edge < min(max(height, width), LARGEST_TILE):
        edge *= 2
    return edge


def grained(noise: Floats) -> Halves:
    """Round to `GRAIN`, within `MOST_STEPS`; read-only."""
    steps = np.clip(np.floor(noise / GRAIN + 0.5), -MOST_STEPS, MOST_STEPS)
    found = np.ascontiguousarray(GRAIN * steps, np.float16)
    found.flags.writeable = False
    return found


@lru_cache(maxsize=4)
def noise_tile(seed: int, levels: int, channels: int, edge: int = TILE) -> Halves:
    """The mixed noise of one seed, a value per pixel: (edge, edge, channels, levels * 3).

    It goes on at its borders.
    """
    return _mixed_and_grained(split(white_steps(seed, (edge, edge), channels), levels))


def _mixed_and_grained(bands: Steps) -> Halves:
    """Mix bands, (levels, 3, channels, H, W), and round: (H, W, channels, levels * 3)."""
    levels, _, channels, height, width = bands.shape
    found = np.empty((height, width, channels, 3 * levels), np.float16)
    for index, band in enumerate(mixed(bands)):  # one at a time: memory
        found[..., index] = grained(band.transpose(1, 2, 0))
    found.flags.writeable = False
    return found


@lru_cache(maxsize=2)
def panorama_noise(seed: int, levels: int, channels: int, height_px: int) -> Halves:
    """Noise for a whole panorama: (height, 2 * height, channels, levels * 3), of unit variance."""
    height, width = size = height_px, 2 * height_px
    margin = panorama_margin(levels)
    whole = [(margin, margin + -edge % (1 << levels)) for edge in size]
    white = np.pad(white_steps(seed, size, channels), ((0, 0), *whole), mode="wrap")
    noise = _mixed_and_grained(split(white, levels))
    return noise[margin : margin + height, margin : margin + width]


def panorama_margin(levels: int) -> int:
    """Pixels around a panorama for which noise is made too: farther than any filter reaches."""
    return 5 << levels


@lru_cache(maxsize=1)
def carried_noise(seed: int, levels: int, channels: int, edge: int) -> NoiseBands:
    """The noise of `noise_tile` with two texels per pixel, to be read between them; read-only."""
    tiles = mixed_bands(seed, levels, channels, edge)
    dense = [
        grained(np.moveaxis(midway(midway(tile, -2), -1), 0, -1))  # a level at a time: memory
        for tile in tiles
    ]
    stacked = np.stack(dense)
    stacked.flags.writeable = False
    return NoiseBands(stacked, fitted_mixing(levels).lag_correlation)


def noise_plane(
    size: tuple[int, int],
    seed: int,
    levels: int,
    channels: int,
    *,
    wraps: bool,
    shift_px: NDArray[np.floating] | None = None,
) -> Floats:
    """Each pixel's noise: (H, W, channels, levels * 3), of unit variance.

    Parameters
    ----------
    size : (height, width)
    shift_px : ndarray, shape (H, W, 2), optional
        The pixel at (x, y) has the noise of (x, y) - shift: what a surface carries along with it.
        Places between pixels keep their variance.
    """
    height, width = size
    edge = tile_edge(height, width)
    if shift_px is None and wraps:
        return panorama_noise(seed, levels, channels, height).astype(np.float64)
    if shift_px is None:
        tile = noise_tile(seed, levels, channels, edge)
        rows, columns = np.arange(height) % edge, np.arange(width) % edge
        return tile[rows[:, None], columns].astype(np.float64)
    noise = carried_noise(seed, levels, channels, edge)
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    place = np.stack([x, y], axis=-1) - shift_px
    found = [np.moveaxis(look_up(noise, level, place), 3, 2) for level in range(levels)]
    return np.concatenate(found, axis=3)
