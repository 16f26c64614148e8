"""All maps of what was lost as one grey picture of 8 bits.

Beyond Blur, section 5.1.3, remaps each channel of each map linearly to 0..255. Variances span
decades, so their roots, deviations, are stored: one scale per level and band. Maps of a level stand
below one another, levels beside one another.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.compression.grid import PolarGrid
from pipeline.compression.lost import VALUES, LostMap

Bytes = NDArray[np.uint8]
Scales = NDArray[np.float32]


def atlas_shape(grids: Sequence[PolarGrid]) -> tuple[int, int]:
    """Rows and columns of the atlas of these maps."""
    return VALUES * grids[0].shape[0], sum(grid.shape[1] for grid in grids)


def pack(maps: Sequence[LostMap]) -> tuple[Bytes, Scales]:
    """Store maps in 8 bits.

    Returns
    -------
    atlas : ndarray of uint8, shape `atlas_shape`
    scales : ndarray of float32, shape (levels, 3)
        The largest deviation of each level and band.
    """
    scales = np.array([np.sqrt(one.variance.max(axis=(0, 1))) for one in maps], np.float32)
    parts = []
    for one, scale in zip(maps, scales, strict=True):
        deviation = np.sqrt(one.variance) / np.where(scale > 0, scale, 1)
        values = np.concatenate([deviation, (one.slope + 1) / 2], axis=2)
        parts.append(np.concatenate(list(np.moveaxis(values, 2, 0)), axis=0))
    return to_bytes(np.concatenate(parts, axis=1)), scales


def unpack(atlas: Bytes, scales: Scales, grids: Sequence[PolarGrid]) -> list[LostMap]:
    """Undo `pack`."""
    ends = np.cumsum([grid.shape[1] for grid in grids])[:-1]
    maps = []
    for grid, scale, part in zip(grids, scales, np.split(atlas / 255, ends, axis=1), strict=True):
        values = np.stack(np.split(part, VALUES, axis=0), axis=-1)
        deviation = values[..., :3] * scale.astype(np.float64)
        maps.append(LostMap(grid, deviation**2, 2 * values[..., 3:] - 1))
    return maps


def to_bytes(values: NDArray[np.floating]) -> Bytes:
    """Round from [0, 1] to 0..255; what lies beyond is clipped."""
    return np.asarray(np.clip(np.rint(255 * values), 0, 255), np.uint8)
