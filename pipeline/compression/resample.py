"""Pictures to polar cells and back. Twin of the way back: unfold.comp.glsl."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pipeline.compression.grid import PolarGrid

Floats = NDArray[np.float64]

MOST_SAMPLES = 32
"""Of a cell along an axis: the paper's bound R, section 5.1.2."""
SAMPLES_PER_PX = 1.5
MARGIN = 2  # rows: as far as interpolation reaches beyond a cell's middle


def to_cells(image: Floats, grid: PolarGrid, *, px: float = 1.0) -> Floats:
    """Average what each cell covers.

    A cell that lies outside the picture takes the value of the nearest one that does not, which
    costs a codec least.

    Parameters
    ----------
    image : ndarray of shape (H, W, channels)
    px : float
        Pixels of the grid's picture per pixel of `image`: 2^k for level k of a pyramid.

    Returns
    -------
    ndarray of shape (rows, columns, channels)
    """
    rows, columns = grid.shape
    sums, counts = np.zeros((rows, columns, image.shape[2])), np.zeros((rows, columns))
    samples = [
        np.clip(np.ceil(SAMPLES_PER_PX * extent / px), 1, MOST_SAMPLES).astype(int).tolist()
        for extent in grid.cell_px()
    ]
    each = np.array(list(zip(*samples, strict=True))).reshape(columns, 2)
    for along, around in sorted({(int(a), int(b)) for a, b in each}):
        alike = np.flatnonzero((each == (along, around)).all(axis=1))
        row = np.arange(rows * around).reshape(rows, 1, around, 1) / around
        column = alike[:, None, None] + np.arange(along) / along
        # A chunk of rows at a time: memory.
        for start in range(0, rows, step := max(1, 1_000_000 // column.size // around)):
            part = slice(start, start + step)
            x, y = grid.positions(row[part] + 0.5 / around, column + 0.5 / along)
            inside = (x >= 0) & (x <= grid.size[0]) & (y >= 0) & (y <= grid.size[1])
            values = np.where(inside[..., None], linear(image, x / px, y / px), 0)
            sums[part, alike] = values.sum(axis=(2, 3))
            counts[part, alike] = inside.sum(axis=(2, 3))
    cells = sums / np.maximum(counts, 1)[..., None]
    empty = counts == 0
    if empty.any() and not empty.all():
        nearest = ndimage.distance_transform_edt(empty, return_distances=False, return_indices=True)
        cells = cells[tuple(nearest)]
    return cells


def from_cells(cells: Floats, grid: PolarGrid) -> Floats:
    """Read cells at the picture's pixels: (rows, columns, channels) to (H, W, channels)."""
    width, height = grid.size
    row, column = grid.places(*np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5))
    return cubic(around(cells, grid), column, row + MARGIN)


def around(cells: Floats, grid: PolarGrid) -> Floats:
    """Add `MARGIN` rows above and below: those at the other end of a whole turn."""
    sides = (MARGIN, MARGIN), (0, 0), (0, 0)
    return np.pad(cells, sides, mode="wrap" if grid.whole_turn else "edge")


def linear(image: Floats, x: Floats, y: Floats) -> Floats:
    """Read (H, W, channels) at positions of one shape; beyond the border the border goes on."""
    return _interpolated(image, x, y, _linear_weights)


def cubic(image: Floats, x: Floats, y: Floats) -> Floats:
    """The same, by Catmull and Rom's cubics."""
    return _interpolated(image, x, y, _cubic_weights)


def _linear_weights(part: Floats) -> dict[int, Floats]:
    return {0: 1 - part, 1: part}


def _cubic_weights(part: Floats) -> dict[int, Floats]:
    square = part * part
    cube = square * part
    return {
        -1: (2 * square - part - cube) / 2,
        0: (2 - 5 * square + 3 * cube) / 2,
        1: (part + 4 * square - 3 * cube) / 2,
        2: (cube - square) / 2,
    }


def _interpolated(
    image: Floats, x: Floats, y: Floats, weights_of: Callable[[Floats], dict[int, Floats]]
) -> Floats:
    """Weigh the texels around each position; `weights_of` a share says which and how much."""
    height, width = image.shape[:2]
    x, y = np.broadcast_arrays(x, y)
    left, top = np.floor(x - 0.5), np.floor(y - 0.5)
    across, down = weights_of(x - 0.5 - left), weights_of(y - 0.5 - top)
    found = np.zeros((*x.shape, image.shape[2]))
    flat = image.reshape(-1, image.shape[2])
    for j, of_row in down.items():
        row = np.clip(top + j, 0, height - 1).astype(np.intp) * width
        for i, of_column in across.items():
            column = np.clip(left + i, 0, width - 1).astype(np.intp)
            found += (of_row * of_column)[..., None] * flat.take(row + column, axis=0)
    return found
