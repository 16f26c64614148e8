"""Pictures to polar cells and back. Twin of the way back: unfold.comp.glsl."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from pipeline.compression.grid import PolarGrid
from pipeline.foveation.displacement import look_up
from pipeline.frame import Floats

MOST_SAMPLES = 32
"""Of a cell along an axis: the paper's bound R, section 5.1.2."""
SAMPLES_PER_PX = 1.5
MARGIN = 1  # rows: as far as linear interpolation reaches beyond a cell's middle


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


def fitted_cells(image: Floats, grid: PolarGrid) -> Floats:
    """Cells that give back more of the image when they are read: as `to_cells`, corrected once.

    Means of cells, read by a cubic, are blurred twice. So what is missing after reading is averaged
    too, and added (one step of Landweber's iteration). A reader needs to know nothing of it.
    """
    cells = to_cells(image, grid)
    return cells + to_cells(image - from_cells(cells, grid), grid)


def from_cells(cells: Floats, grid: PolarGrid) -> Floats:
    """Read cells (rows, columns, channels) at pixels, by a cubic: (H, W, channels)."""
    width, height = grid.size
    row, column = grid.places(*np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5))
    turned = np.ascontiguousarray(cells.transpose(1, 0, 2))  # only columns go on at the other side
    return look_up(turned, row, column, wraps=grid.whole_turn)


def around(cells: Floats, grid: PolarGrid) -> Floats:
    """Add `MARGIN` rows above and below: those at the other end of a whole turn."""
    sides = (MARGIN, MARGIN), (0, 0), (0, 0)
    return np.pad(cells, sides, mode="wrap" if grid.whole_turn else "edge")


def linear(image: Floats, x: Floats, y: Floats) -> Floats:
    """Read (H, W, channels) at positions of one shape; beyond the border the border goes on."""
    places = np.stack(np.broadcast_arrays(y - 0.5, x - 0.5))
    planes = [
        ndimage.map_coordinates(plane, places, order=1, mode="nearest")
        for plane in np.moveaxis(image, -1, 0)
    ]
    return np.stack(planes, axis=-1)
