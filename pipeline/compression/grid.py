"""Polar cells around a gaze, as small as a density says.

Walton et al. 2021 ("Beyond Blur"), sections 5.1.1 and 5.1.2: along the radius the density of
samples falls with the eccentricity. Its integral (the paper's CDF) says in which column a radius
lies, and the integral's inverse where a column's cells lie. The paper names the density ``r^-2``.
That is per area, and has no finite integral; along the radius it is ``1 / r``, here with at most
one column per pixel.

Twin of `from_cells`: unfold.comp.glsl.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import ndimage

from pipeline.foveation.displacement import look_up_cubic
from pipeline.frame import Floats

TURN = 2 * math.pi
_ROUNDING = 1e-9  # so that a whole number of cells, computed, gets no cell more


@dataclass(frozen=True)
class Density:
    """Columns per pixel of radius: 0 up to `start_px`, then 1, and ``knee_px / r`` from a knee on.

    Parameters
    ----------
    start_px : float
        Nothing is kept nearer to the gaze; at least 0.
    knee_px : float
        Beyond it cells grow with the radius; above 0.
    """

    start_px: float
    knee_px: float

    @property
    def turn_px(self) -> float:
        """Radius from which on cells grow."""
        return max(self.start_px, self.knee_px)

    def per_px(self, radius_px: Floats) -> Floats:
        """Columns per pixel of radius (Fig. 10, a)."""
        density = self.knee_px / np.maximum(radius_px, self.knee_px)
        return np.where(radius_px < self.start_px, 0.0, density)

    def columns(self, radius_px: Floats) -> Floats:
        """Integrate the density from `start_px` on; negative before it."""
        near = np.minimum(radius_px, self.turn_px) - self.start_px
        far = np.log(np.maximum(radius_px, self.turn_px) / self.turn_px)
        return np.asarray(near + self.knee_px * far)

    def radius_px(self, columns: Floats) -> Floats:
        """Invert `columns`."""
        flat = self.turn_px - self.start_px
        far = np.exp(np.maximum(columns - flat, 0) / self.knee_px)
        return np.asarray(self.start_px + np.minimum(columns, flat) + self.turn_px * (far - 1))


@dataclass(frozen=True)
class PolarGrid:
    """Cells around a gaze: rows are angles, columns are radii. Beyond the knee they are square.

    Parameters
    ----------
    size : (width, height)
        Of the picture, pixels.
    gaze_px : (x, y)
        Anywhere, also off the picture.
    rows_per_turn : int
        Angles on a whole circle. The knee lies where a circle has as many pixels.
    from_px : float
        Nothing is kept nearer to the gaze.
    """

    size: tuple[int, int]
    gaze_px: tuple[float, float]
    rows_per_turn: int
    from_px: float = 0.0

    @cached_property
    def density(self) -> Density:
        """Along the radius; it starts where the picture does."""
        (width, height), (x, y) = self.size, self.gaze_px
        nearest = math.hypot(max(-x, 0, x - width), max(-y, 0, y - height))
        return Density(max(self.from_px, nearest), self.rows_per_turn / TURN)

    @cached_property
    def farthest_px(self) -> float:
        """Distance of the gaze from the farthest corner."""
        (width, height), (x, y) = self.size, self.gaze_px
        return math.hypot(max(x, width - x), max(y, height - y))

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Rows and columns; no columns where all of the picture is nearer than `from_px`."""
        rows = math.ceil(self.rows_per_turn * self.arc[1] / TURN - _ROUNDING)
        columns = float(self.density.columns(np.array(self.farthest_px)))
        return max(1, rows), max(0, math.ceil(columns - _ROUNDING))

    @property
    def whole_turn(self) -> bool:
        """True if the last row goes on at the first one."""
        return self.arc[1] == TURN

    def cell_px(self) -> tuple[Floats, Floats]:
        """Extent of each column's cells along the radius and along the circle, pixels."""
        edges = self.density.radius_px(np.arange(self.shape[1] + 1, dtype=np.float64))
        middle = self.density.radius_px(np.arange(self.shape[1], dtype=np.float64) + 0.5)
        return np.diff(edges), middle * (TURN / self.rows_per_turn)

    def positions(self, rows: Floats, columns: Floats) -> tuple[Floats, Floats]:
        """Positions on the picture of places in the grid: x and y, pixels."""
        angle = self.arc[0] + rows * (TURN / self.rows_per_turn)
        radius = self.density.radius_px(columns)
        x, y = self.gaze_px
        return x + radius * np.cos(angle), y + radius * np.sin(angle)

    def places(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Places in the grid of positions on the picture: rows and columns; undo `positions`."""
        across, down = x - self.gaze_px[0], y - self.gaze_px[1]
        # Measured from the middle of what the arc leaves out: no angle jumps within the arc.
        left_out = (TURN - self.arc[1]) / 2
        angle = (np.arctan2(down, across) - self.arc[0] + left_out) % TURN - left_out
        return angle * (self.rows_per_turn / TURN), self.density.columns(np.hypot(across, down))

    @cached_property
    def arc(self) -> tuple[float, float]:
        """First angle and span of what holds the picture; a whole turn if the gaze is on it."""
        (width, height), (x, y) = self.size, self.gaze_px
        if 0 < x < width and 0 < y < height:
            return 0.0, TURN
        middle = math.atan2(height / 2 - y, width / 2 - x)
        corners = [(cx - x, cy - y) for cx in (0, width) for cy in (0, height)]
        turns = [
            (math.atan2(down, across) - middle + math.pi) % TURN - math.pi
            for across, down in corners
            if (across, down) != (0, 0)
        ]
        return middle + min(turns), max(turns) - min(turns)


MOST_SAMPLES = 32
"""Most samples of a cell along an axis: the paper's bound R, section 5.1.2."""
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


RELAXATIONS = (1.03, 1.33, 2.24, 4.34)
"""Factors of the corrections of `fitted_cells`: inverse zeros of the Chebyshev polynomial of degree
four on [0.2, 1], the shares of a detail that reading its means gives back."""


def fitted_cells(image: Floats, grid: PolarGrid) -> Floats:
    """Cells that give back more of the image when they are read: as `to_cells`, then corrected.

    Means of cells, read by a cubic, are blurred twice. So what is missing after reading is averaged
    too, and added, four times (Landweber's iteration; with `RELAXATIONS` these steps do as much as
    eight plain ones). A reader needs to know nothing of it.
    """
    cells = to_cells(image, grid)
    for factor in RELAXATIONS:
        cells += factor * to_cells(image - from_cells(cells, grid), grid)
    return cells


def from_cells(cells: Floats, grid: PolarGrid) -> Floats:
    """Read cells (rows, columns, channels) at pixels, by a cubic: (H, W, channels)."""
    width, height = grid.size
    row, column = grid.places(*np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5))
    turned = np.ascontiguousarray(cells.transpose(1, 0, 2))  # only columns go on at the other side
    return look_up_cubic(turned, row, column, wraps=grid.whole_turn)


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
