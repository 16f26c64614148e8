"""One whole-pixel shift per tile of the hole, agreed among neighbours.

After the shift-map of Pritch et al. 2009 (section 2): a fill is a map of shifts, with a data term
(sources must be known, and look as the base does) and a smoothness term (neighbours go together).
There a graph cut labels pixels; here tiles take the shifts of their neighbours, or small steps from
their own, where that lowers the cost (as in PatchMatch, Barnes et al. 2009).

Tiles lie in the source frame (pixel less its motion), so they move with the background. All is
reckoned in whole numbers, so that both twins choose alike.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.background_texture.reference import at
from pipeline.shiftmap.base import Ways
from pipeline.shiftmap.settings import (
    COST_SCALE,
    DISAGREEMENT_COST,
    DISAGREEMENT_PX,
    ENCODED_STEPS,
    FARTHER_COST,
    GUIDE_STEPS,
    LEAST_COMPARED,
    LENGTHS,
    NOT_KNOWN_COST,
    OVERLAP_POWER,
    STEPS_PX,
    SUBPIXELS,
    TILE,
    TILE_PX,
    WINDOW_PX,
    WINDOW_STEP_PX,
)

NEIGHBOURS = tuple((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0))
CORNERS = ((0, 0), (0, 1), (1, 0), (1, 1))
IMPOSSIBLE = 1 << 24  # more than any cost


@dataclass(frozen=True, eq=False)
class Tiles:
    """The N tiles that hold hole pixels.

    Attributes
    ----------
    cell : (N, 2)
        Row and column in the table of tiles, which goes on from its end at its beginning.
    index : (rows, columns)
        Which tile lies where; -1: none.
    corner : (N, 2)
        Its first pixel in the target, rounded.
    guide : (N,)
        Mean over its hole pixels, in `GUIDE_STEPS`.
    way, way_px, across_px : (N, 2), (N,), (N,)
        The sum over its hole pixels of the step to the background; the most steps there; how wide
        the hole is along the way, at most.
    count : (N,)
        How many hole pixels it has.
    """

    cell: NDArray[np.intp]
    index: NDArray[np.intp]
    corner: NDArray[np.intp]
    guide: NDArray[np.intp]
    way: NDArray[np.intp]
    way_px: NDArray[np.intp]
    across_px: NDArray[np.intp]
    count: NDArray[np.intp]

    def at(self, place: NDArray[np.intp]) -> NDArray[np.intp]:
        """Which tile lies at a place, (..., 2), of the grid; -1: none."""
        cell = place % self.index.shape
        return self.index[cell[..., 0], cell[..., 1]]


def grid_subpixels(flow_px: NDArray[np.float32]) -> NDArray[np.intp]:
    """Where each pixel's centre lies in the grid of tiles, (H, W, 2), in parts of a pixel."""
    pixel = np.moveaxis(np.indices(flow_px.shape[:2]), 0, -1)
    motion = np.rint(SUBPIXELS * flow_px[..., ::-1]).astype(np.intp)
    return np.asarray(SUBPIXELS * pixel + SUBPIXELS // 2 - motion)


def table_size(size: tuple[int, int]) -> tuple[int, int]:
    """Rows and columns of the table of tiles: room for twice the frame either way."""
    rows, columns = (2 * (-(-length // TILE_PX)) + 2 for length in size)
    return rows, columns


def rounded(total: NDArray[np.intp], count: NDArray[np.intp]) -> NDArray[np.intp]:
    """Divide whole numbers, to the nearest one; halves go up."""
    return np.asarray((2 * total + count) // (2 * count))


def cut_tiles(
    thick: NDArray[np.bool_],
    guide: NDArray[np.intp],
    flow_px: NDArray[np.float32],
    ways: Ways,
) -> Tiles:
    """Cut the part of the holes that gets detail, `thick`, into tiles; `ways` are all pixels'."""
    some = thick[ways.pixel[:, 0], ways.pixel[:, 1]]
    pixel = ways.pixel[some]
    place, part = np.divmod(grid_subpixels(flow_px)[thick], TILE)
    shape = table_size(thick.shape)
    used, of_pixel = np.unique(place % shape @ (shape[1], 1), return_inverse=True)
    count = np.bincount(of_pixel)

    def summed(values: NDArray[np.integer]) -> NDArray[np.intp]:
        return np.asarray(np.rint(np.bincount(of_pixel, values)), np.intp)

    def summed_pairs(values: NDArray[np.integer]) -> NDArray[np.intp]:
        return np.stack([summed(values[:, 0]), summed(values[:, 1])], axis=1)

    def most(values: NDArray[np.intp]) -> NDArray[np.intp]:
        found = np.zeros(len(used), np.intp)
        np.maximum.at(found, of_pixel, values)
        return found

    centre = SUBPIXELS * pixel + SUBPIXELS // 2
    corner = rounded(summed_pairs(centre - part), SUBPIXELS * count[:, None])
    index = np.full(shape, -1, np.intp)
    cell = np.stack(np.divmod(used, shape[1]), axis=1)
    index[cell[:, 0], cell[:, 1]] = np.arange(len(used))
    way = summed_pairs(ways.step[some])
    px = most(ways.steps[some]), most(ways.across_px[some])
    return Tiles(cell, index, corner, rounded(summed(guide[thick]), count), way, *px, count)


@dataclass(frozen=True, eq=False)
class Planes:
    """What the search compares, in whole steps."""

    hole: NDArray[np.bool_]  # (H, W)
    guide: NDArray[np.intp]  # (H, W), of `GUIDE_STEPS`
    colour: NDArray[np.intp]  # (H, W, 3), of `ENCODED_STEPS`: what is known, and the base
    low: NDArray[np.intp]  # (H, W, 3), the same for 2x2 pixels


def planes_of(
    hole: NDArray[np.bool_],
    guide: NDArray[np.floating],
    colour: NDArray[np.floating],
    half_low: NDArray[np.floating],
) -> Planes:
    """Round to whole steps."""

    def steps(values: NDArray[np.floating], count: int) -> NDArray[np.intp]:
        return np.asarray(np.rint(count * np.clip(values, 0.0, 1.0)), np.intp)

    low = steps(half_low, ENCODED_STEPS).repeat(2, axis=0).repeat(2, axis=1)
    low = low[: hole.shape[0], : hole.shape[1]]
    return Planes(hole, steps(guide, GUIDE_STEPS), steps(colour, ENCODED_STEPS), low)


class Search:
    """The cost of a shift, and the search for the least."""

    def __init__(self, tiles: Tiles, planes: Planes, threshold: float) -> None:
        self.tiles, self._planes = tiles, planes
        self._threshold = round(GUIDE_STEPS * threshold)
        self._size = np.array(planes.hole.shape)
        span = np.arange(-WINDOW_PX, TILE_PX + WINDOW_PX, WINDOW_STEP_PX)
        window = np.stack(np.meshgrid(span, span, indexing="ij"), axis=-1).reshape(-1, 2)
        self._pixel = tiles.corner[:, None] + window
        inside = self._inside(self._pixel)
        hole, guide, colour = (
            at(a, self._pixel) for a in (planes.hole, planes.guide, planes.colour)
        )
        inside &= np.abs(guide - tiles.guide[:, None]) <= self._threshold
        self._own, self._beside = inside & hole, inside & ~hole
        self._shown = colour

    def _inside(self, place: NDArray[np.intp]) -> NDArray[np.bool_]:
        return np.asarray(((place >= 0) & (place < self._size)).all(axis=-1))

    def _sources(
        self, which: NDArray[np.intp], place: NDArray[np.intp]
    ) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """By how much places, (M, n, 2), are nearer than tiles, (M,), and which may be copied."""
        nearer = self.tiles.guide[which, None] - at(self._planes.guide, place)
        known = self._inside(place) & ~at(self._planes.hole, place)
        return nearer, known & (nearer <= self._threshold)

    def cost(self, which: NDArray[np.intp], shift: NDArray[np.intp]) -> NDArray[np.intp]:
        """Return the cost of moving tiles `which`, (M,), by `shift`, (M, 2), neighbours aside.

        Of the window's pixels on the tile's surface, the mean squared difference of base and
        sources' low-pass in the hole, and of colours beside it, that over as many as a tile has or
        more; `NOT_KNOWN_COST` times the share of hole pixels without a source, and `FARTHER_COST`
        times that of sources which lie clearly behind.
        """
        planes = self._planes
        place = self._pixel[which] + shift[:, None]
        nearer, source = self._sources(which, place)
        own, beside = self._own[which], self._beside[which]
        there = np.where(own[..., None], at(planes.low, place), at(planes.colour, place))
        error = ((self._shown[which] - there) ** 2).sum(axis=-1)
        found, compared = own & source, beside & source
        pixels, sources = own.sum(axis=1), found.sum(axis=1)
        farther = (found & (-nearer > self._threshold)).sum(axis=1)
        least = np.maximum(pixels, 1)
        cost = (
            COST_SCALE * (error * found).sum(axis=1) // np.maximum(sources, 1)
            + COST_SCALE
            * (error * compared).sum(axis=1)
            // np.maximum(compared.sum(axis=1), LEAST_COMPARED)
            + COST_SCALE * NOT_KNOWN_COST * (pixels - sources) // least
            + COST_SCALE * FARTHER_COST * farther // least
        )
        return np.asarray(cost)

    def first_shifts(self) -> NDArray[np.intp]:
        """Return each tile's best shift along the parallax.

        They go from the whole hole's width on: shorter ones bring one piece of the background to
        several tiles. Where no background lies so far, they go from just past the hole.
        """
        tiles = self.tiles
        every = np.arange(len(tiles.cell))
        longer = np.abs(tiles.way).max(axis=1)
        # Ways that cancel out have no direction; any will do, for the search mends it.
        none = 5 * longer <= tiles.count
        way = np.where(none[:, None], (0, 1), tiles.way)
        longer = np.where(none, 1, longer)[:, None]

        def along(length_px: NDArray[np.intp]) -> NDArray[np.intp]:
            return rounded(length_px[:, None] * way, longer)

        middle = tiles.corner + TILE_PX // 2 + along(tiles.across_px + 1)
        far = self._sources(every, middle[:, None])[1][:, 0]
        start = np.where(far, tiles.across_px, tiles.way_px)
        shifts = [along(start + 1 + length) for length in range(LENGTHS)]
        best = np.stack([self.cost(every, shift) for shift in shifts]).argmin(axis=0)
        return np.asarray(np.stack(shifts)[best, every])

    def agree(self, shift: NDArray[np.intp]) -> NDArray[np.intp]:
        """Let tiles take neighbours' shifts, or small steps, where cost with disagreement falls.

        All tiles choose at once, by what their neighbours had before.
        """
        every = np.arange(len(shift))
        beside = np.stack([self.tiles.at(self.tiles.cell + n) for n in NEIGHBOURS], axis=1)
        for reach in STEPS_PX:
            steps = [(0, reach), (reach, 0), (0, -reach), (-reach, 0)]
            proposals = [shift, *(shift[n] for n in beside.T), *(shift + step for step in steps)]
            offered = [every >= 0, *(n >= 0 for n in beside.T), *([every >= 0] * len(steps))]
            cost = np.stack(
                [
                    np.where(may, self.cost(every, p) + disagreement(p, beside, shift), IMPOSSIBLE)
                    for p, may in zip(proposals, offered, strict=True)
                ]
            )
            shift = np.stack(proposals)[cost.argmin(axis=0), every]
        return shift


def disagreement(
    shift: NDArray[np.intp], beside: NDArray[np.intp], all_shifts: NDArray[np.intp]
) -> NDArray[np.intp]:
    """Mean over neighbours of how far their shifts are off, `DISAGREEMENT_PX` at most."""
    there = beside >= 0
    far = np.abs(all_shifts[beside] - shift[:, None]).sum(axis=-1).clip(max=DISAGREEMENT_PX)
    count = np.maximum(there.sum(axis=1), 1)
    scale = COST_SCALE * DISAGREEMENT_COST
    return np.asarray(scale * (far * there).sum(axis=1) // (DISAGREEMENT_PX * count))


@dataclass(frozen=True, eq=False)
class Blend:
    """The four tiles around each of N pixels."""

    own: NDArray[np.intp]  # (N,), the one that the pixel lies in
    tile: NDArray[np.intp]  # (4, N); -1: none
    share: NDArray[np.float64]  # (4, N), bilinear


def blend_of(tiles: Tiles, grid: NDArray[np.intp]) -> Blend:
    """Find the tiles around pixels at `grid`, (N, 2), of `grid_subpixels`."""
    first, part = np.divmod(grid - TILE // 2, TILE)
    found, shares = [], []
    for corner in np.array(CORNERS):
        found.append(tiles.at(first + corner))
        shares.append((np.where(corner, part, TILE - part) / TILE).prod(axis=1))
    return Blend(tiles.at(grid // TILE), np.stack(found), np.stack(shares))


@dataclass(frozen=True, eq=False)
class Source:
    """What may be copied: `values`, (H, W, n), but for holes and what is clearly nearer."""

    values: NDArray[np.float64]
    hole: NDArray[np.bool_]
    guide: NDArray[np.float64]
    threshold: float

    def read(
        self, pixel: NDArray[np.intp], shift: NDArray[np.intp]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Read where hole pixels, (N, 2), are shifted to: (N, n); and whether it is a source."""
        there = pixel + shift
        inside = ((there >= 0) & (there < self.hole.shape)).all(axis=1)
        nearer = at(self.guide, pixel) - at(self.guide, there)
        return at(self.values, there), inside & ~at(self.hole, there) & (nearer <= self.threshold)


def shifted(
    source: Source, pixel: NDArray[np.intp], blend: Blend, shift: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Copy to hole pixels, (N, 2), what the tiles' shifts lead to; 0 without a source: (N, n).

    Each pixel blends what the four tiles around it bring, by sharpened bilinear shares, so that
    tiles leave no edges. What different shifts bring is taken as uncorrelated, and the sum scaled
    to keep its variance, but never beyond the least and the most of them.
    """
    total, shares = np.zeros((len(pixel), source.values.shape[-1])), []
    least, most = np.full(total.shape, np.inf), np.full(total.shape, -np.inf)
    shifts = shift[blend.tile]
    for tile, bilinear, by in zip(blend.tile, blend.share, shifts, strict=True):
        found, valid = source.read(pixel, by)
        shares.append(np.where(valid & (tile >= 0), bilinear**OVERLAP_POWER, 0.0))
        total += shares[-1][:, None] * found
        counts = shares[-1][:, None] > 0
        least = np.where(counts, np.minimum(least, found), least)
        most = np.where(counts, np.maximum(most, found), most)
    power = np.zeros(len(pixel))
    for i, j in np.ndindex(4, 4):
        power += shares[i] * shares[j] * (shifts[i] == shifts[j]).all(axis=1)
    scale = np.sqrt(power)[:, None]
    scaled = np.divide(total, scale, out=np.zeros_like(total), where=scale > 0)
    return np.where(scale > 0, scaled.clip(least, most), 0.0)
