"""Maps of what the cells of the base lost, and the noise that gives it back.

Beyond Blur, section 5.1: beside the picture, statistics of every level of a pyramid are kept, each
from where the picture's own cells no longer hold that level's waves. What is kept is what the
decoded base lacks: the mean square of the picture's coefficients less the base's. So noise gives
back what cells and codec took, and nothing twice.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.compression.grid import MARGIN, PolarGrid, around, linear, to_cells
from pipeline.foveation.chain import chain_of
from pipeline.foveation.noise_plane import noise_plane
from pipeline.foveation.pooled_moments import (
    BLOCK_HALVINGS,
    SMALLEST_VARIANCE,
    LevelMoments,
    WantedMoments,
    coefficient_moments,
)
from pipeline.foveation.reference import lost_noise
from pipeline.frame import Floats

MOST_LEVELS = 5
COARSER = 9
"""Cells of the base along an edge of a map's cell."""
VALUES = 5
"""Number of values of a map's cell: luma's variance in three bands, and the slopes of Cb and Cr."""


@dataclass(frozen=True, eq=False)
class LostMap:
    """Moments of what one level of the pyramid lost.

    Parameters
    ----------
    grid : PolarGrid
        Of the map.
    variance : ndarray of shape (rows, columns, 3)
        Of luma's coefficients in the level's bands.
    slope : ndarray of shape (rows, columns, 2)
        Of Cb and Cr on luma, from -1 to 1.
    """

    grid: PolarGrid
    variance: Floats
    slope: Floats


def map_grids(base: PolarGrid, most_levels: int = MOST_LEVELS) -> list[PolarGrid]:
    """Grids of the maps that a base needs: a level each, none for what no cell loses.

    A level's map starts where cells of the base are wider than half its coefficients are apart,
    and not before they are wider than a pixel: within, the base holds the picture.
    """
    rows = max(8, round(base.rows_per_turn / COARSER))
    knee_px = base.density.knee_px
    # The last level has at least 8 coefficients along the longer edge.
    deepest = max(1, int(math.log2(max(8, *base.size) / 8)) + 1)
    grids = [
        PolarGrid(base.size, base.gaze_px, rows, knee_px * max(1.0, 2.0 ** (level - 1)))
        for level in range(min(most_levels, deepest))
    ]
    return [grid for grid in grids if grid.shape[1] > 0]


def lost_maps(
    picture: NDArray[np.floating], decoded: NDArray[np.floating], grids: Sequence[PolarGrid]
) -> list[LostMap]:
    """Average over each map's cells what `decoded` lacks of `picture`: (H, W, 3), R'G'B'."""
    theirs, ours = (_moments(image, len(grids)) for image in (picture, decoded))
    found = []
    for level, (grid, wanted, held) in enumerate(zip(grids, theirs, ours, strict=True)):
        energy = wanted.square.sum(axis=2, keepdims=True)
        values = np.concatenate([wanted.square - held.square, wanted.cross, energy], axis=2)
        lost, cross, energy = np.split(to_cells(values, grid, px=float(1 << level)), (3, 5), axis=2)
        # Chroma goes with luma as in the picture: what a codec leaves out of chroma alone would
        # come back as colour that the picture never had.
        slope = np.clip(cross / (energy + SMALLEST_VARIANCE), -1, 1)
        found.append(LostMap(grid, np.maximum(lost, 0), slope))
    return found


def _moments(image: NDArray[np.floating], levels: int) -> list[LevelMoments]:
    lows = chain_of(image.astype(np.float64), levels - 1, wraps=False) if levels else []
    return [LevelMoments.unpacked(coefficient_moments(low, wraps=False)) for low in lows]


def mean_of_maps(maps: Sequence[Sequence[LostMap]]) -> list[LostMap]:
    """Average the maps of several frames, level by level; slopes by the variance they belong to."""
    found = []
    for same in zip(*maps, strict=True):
        variance = np.mean([one.variance for one in same], axis=0)
        weights = np.stack([one.variance.sum(axis=2) + SMALLEST_VARIANCE for one in same])
        slopes = np.stack([one.slope for one in same])
        slope = (weights[..., None] * slopes).sum(axis=0) / weights.sum(axis=0)[..., None]
        found.append(LostMap(same[0].grid, variance, slope))
    return found


def wanted_of(maps: Sequence[LostMap]) -> WantedMoments:
    """Read the maps at blocks of 4x4 pixels. A map fades in over its first cell."""
    width, height = maps[0].grid.size
    block = 1 << BLOCK_HALVINGS
    at = np.meshgrid(
        (np.arange(-(-width // block)) + 0.5) * block,
        (np.arange(-(-height // block)) + 0.5) * block,
    )
    variances, slopes = [], []
    for one in maps:
        row, column = one.grid.places(*at)
        values = around(np.concatenate([one.variance, one.slope], axis=2), one.grid)
        read = linear(values, column, row + MARGIN)
        variances.append(np.clip(column, 0, 1)[..., None] * read[..., :3])
        slopes.append(read[..., 3:])
    nothing = np.zeros((*at[0].shape, 3 * len(maps), 2))
    return WantedMoments(np.concatenate(variances, axis=2), np.stack(slopes, axis=2), nothing)


def with_noise(base: Floats, maps: Sequence[LostMap], seed: int) -> Floats:
    """Add noise of the variance that was lost, as it lies on the screen, to R'G'B': (H, W, 3)."""
    plane = noise_plane(base.shape[:2], seed, len(maps), 1, wraps=False)
    noise = lost_noise(wanted_of(maps), plane, len(maps), "follow", wraps=False)
    return noise.on(base)
