"""The fills' noise, laid over a whole picture.

A picture gets a tile as large as itself, up to `LARGEST_TILE`: on any even texture one would see
the tile of fills, 256 px, repeat itself. Noise that surfaces carry is read between texels, from
the tile of fills; there it does.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.noise.tile import TILE, look_up, mixed_bands, noise_bands

LARGEST_TILE = 1024  # edge, pixels: beyond it memory would grow and little would be gained
SEAM_PX = 128  # over so many columns a panorama's noise becomes what goes on at its other side
LARGEST_SEED = 2**63 - 1


def check_seed(seed: int) -> int:
    """Require a whole number from 0 to 2**63 - 1."""
    whole = isinstance(seed, int | np.integer) and not isinstance(seed, bool)
    if not whole or not 0 <= int(seed) <= LARGEST_SEED:
        raise InputError(f"seed must be a whole number from 0 to 2**63 - 1 (got {seed!r})")
    return int(seed)


def tile_edge(height: int, width: int) -> int:
    """Return the edge of the tile for a picture: a power of two, in pixels."""
    edge = TILE
    while edge < min(max(height, width), LARGEST_TILE):
        edge *= 2
    return edge


@lru_cache(maxsize=4)
def noise_tile(
    seed: int, levels: int, channels: int, edge: int = TILE, wrapped_width: int | None = None
) -> NDArray[np.float32]:
    """The mixed noise of one seed, a value per pixel: (edge, width, channels, levels * 3).

    It goes on at its borders. The width is `edge`, or `wrapped_width`, so that it fits once around
    a panorama: there the last columns fade into what comes before the first, at constant power.
    """
    tiles = mixed_bands(seed, levels, channels, edge)  # (level, band, channel, row, column)
    tile = tiles.transpose(3, 4, 2, 0, 1).reshape(edge, edge, channels, 3 * levels)
    if wrapped_width is not None and wrapped_width % edge:
        column = np.arange(wrapped_width)
        seam = min(SEAM_PX, wrapped_width)
        share = np.clip((column - (wrapped_width - seam) + 0.5) / seam, 0, 1)[:, None, None]
        ahead = tile[:, (column - wrapped_width) % edge]  # ends where column 0 begins
        lag = wrapped_width % edge
        alike = (tile * np.roll(tile, lag, axis=1)).mean(axis=(0, 1)) / (tile**2).mean(axis=(0, 1))
        mixed = np.sqrt(1 - share) * tile[:, column % edge] + np.sqrt(share) * ahead
        tile = mixed / np.sqrt(1 + 2 * np.sqrt(share * (1 - share)) * alike)
    found = np.ascontiguousarray(tile, np.float32)
    found.flags.writeable = False
    return found


def noise_plane(
    size: tuple[int, int],
    seed: int,
    levels: int,
    channels: int,
    *,
    wraps: bool,
    shift_px: NDArray[np.floating] | None = None,
) -> NDArray[np.float64]:
    """Each pixel's noise: (H, W, channels, levels * 3), of unit variance.

    Parameters
    ----------
    size : (height, width)
    shift_px : ndarray, shape (H, W, 2), optional
        The pixel at (x, y) has the noise of (x, y) - shift: what a surface carries along with it.
        Places between pixels keep their variance. Whole panoramas cannot be shifted.
    """
    height, width = size
    if shift_px is None:
        edge = tile_edge(height, width)
        tile = noise_tile(seed, levels, channels, edge, width if wraps else None)
        rows, columns = np.arange(height) % tile.shape[0], np.arange(width) % tile.shape[1]
        return np.asarray(tile[rows[:, None], columns], np.float64)
    noise = noise_bands(seed, levels, channels)
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    place = np.stack([x, y], axis=-1) - shift_px
    found = [np.moveaxis(look_up(noise, level, place), 3, 2) for level in range(levels)]
    return np.concatenate(found, axis=3)
