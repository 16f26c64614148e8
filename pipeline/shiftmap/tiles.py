"""One whole-pixel shift per tile of the hole, agreed among neighbours.

After the shift-map of Pritch et al. 2009 (section 2): a fill is a map of shifts, with a data term
(sources must be known, and look as the base does) and a smoothness term (neighbours go together).
There a graph cut labels pixels; here tiles take the shifts of their neighbours, or small steps from
their own, where that lowers the cost (as in PatchMatch, Barnes et al. 2009).

Tiles lie in the source frame (pixel less its motion), so they move with the background.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.noise.hashing import pcg3d
from pipeline.shiftmap.base import Ways
from pipeline.shiftmap.settings import (
    ASIDE_EVERY,
    ASIDES_PX,
    COST_SCALE,
    DISAGREEMENT_COST,
    DISAGREEMENT_PX,
    ENCODED_STEPS,
    FARTHER_COST,
    LENGTHS,
    NOT_KNOWN_COST,
    OVERLAP_POWER,
    RANDOM_REACH_PX,
    SWEEPS,
    TILE_PX,
    WINDOW_PX,
    WINDOW_STEP_PX,
)

NEIGHBOURS = tuple((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0))
OUTSIDE = -np.inf  # guide of what is no source: nearer than everything
WORSE = np.iinfo(np.int64).max


@dataclass(frozen=True, eq=False)
class Tiles:
    """The N tiles that hold hole pixels.

    Attributes
    ----------
    place : (N, 2)
        Row and column in the grid of the source frame; tile (0, 0) begins at its first pixel.
    index : (rows, columns)
        Which tile lies where; -1: none. Starts at `first` and has an empty rim.
    corner : (N, 2)
        Its first pixel in the target, rounded.
    label : (H, W)
        Which tile a hole pixel belongs to; -1 outside holes.
    guide, way, way_px : (N,), (N, 2), (N,)
        Means over its hole pixels of guide and of the step to the background, scaled to a longer
        part of 1; the most steps to the background.
    """

    place: NDArray[np.intp]
    index: NDArray[np.intp]
    first: NDArray[np.intp]
    corner: NDArray[np.intp]
    label: NDArray[np.intp]
    guide: NDArray[np.float64]
    way: NDArray[np.float64]
    way_px: NDArray[np.intp]


def tile_coordinates(flow_px: NDArray[np.float32]) -> NDArray[np.float64]:
    """Where each pixel lies in the grid, (H, W, 2), row and column; whole: a tile's centre."""
    height, width, _ = flow_px.shape
    pixel = np.moveaxis(np.indices((height, width)), 0, -1)
    return np.asarray((pixel - flow_px[..., ::-1].astype(np.float64) + 0.5) / TILE_PX - 0.5)


def cut_tiles(
    thick: NDArray[np.bool_],
    guide: NDArray[np.float64],
    flow_px: NDArray[np.float32],
    ways: Ways,
) -> Tiles:
    """Cut the part of the holes that gets detail, `thick`, into tiles; `ways` are its pixels'."""
    belongs = np.floor(tile_coordinates(flow_px)[thick] + 0.5).astype(np.intp)
    first = belongs.min(axis=0, initial=0) - 1
    shape = belongs.max(axis=0, initial=0) - first + 2
    flat = (belongs - first) @ (shape[1], 1)
    used, of_pixel = np.unique(flat, return_inverse=True)
    place = np.stack(np.divmod(used, shape[1]), axis=1) + first
    index = np.full(shape, -1, np.intp)
    index.flat[used] = np.arange(len(used))
    label = np.full(thick.shape, -1, np.intp)
    label[thick] = of_pixel
    count = np.bincount(of_pixel)

    def mean(values: NDArray[np.floating]) -> NDArray[np.float64]:
        return np.bincount(of_pixel, values) / count

    way = np.stack([mean(ways.step[:, k]) for k in (0, 1)], axis=1)
    longer = np.abs(way).max(axis=1, keepdims=True)
    # Ways that cancel out have no direction; any will do, for the search mends it.
    way = np.where(longer > 0.2, way / np.maximum(longer, 0.2), (0.0, 1.0))
    way_px = np.zeros(len(used), np.intp)
    np.maximum.at(way_px, of_pixel, ways.steps)
    motion = np.stack([mean(flow_px[thick][:, k]) for k in (1, 0)], axis=1)
    corner = np.rint(place * TILE_PX + motion).astype(np.intp)
    return Tiles(place, index, first, corner, label, mean(guide[thick]), way, way_px)


class Search:
    """The cost of a shift, and the search for the least.

    Parameters
    ----------
    colour, base, low : (H, W, 3)
        What is known; the holes filled smoothly; the low-pass of what is known.
    """

    def __init__(
        self,
        tiles: Tiles,
        hole: NDArray[np.bool_],
        guide: NDArray[np.float64],
        colour: NDArray[np.float64],
        base: NDArray[np.float64],
        low: NDArray[np.float64],
        threshold: float,
    ) -> None:
        self.tiles = tiles
        self._threshold = threshold
        # A rim of one pixel that is no source stands for all that lies outside.
        source_guide = np.pad(np.where(hole, OUTSIDE, guide), 1, constant_values=OUTSIDE)
        self._stride = source_guide.shape[1]
        self._source_guide = source_guide.ravel()
        planes = np.pad(np.stack([_steps(low), _steps(colour)]), ((0, 0), (1, 1), (1, 1), (0, 0)))
        self._sources = planes.reshape(-1, 3)
        self._size = np.array(hole.shape)
        window, lattice = _window()
        pixel = tiles.corner[:, None] + window
        within = ((pixel >= 0) & (pixel < hole.shape)).all(axis=-1)
        row, column = np.moveaxis(pixel.clip(0, self._size - 1), -1, 0)
        self._pixel = pixel.astype(np.int32)
        me = np.arange(len(pixel))[:, None]
        self._own = within & (tiles.label[row, column] == me)
        same = np.abs(guide[row, column] - tiles.guide[:, None]) <= threshold
        self._beside = within & lattice & ~hole[row, column] & same
        # What is own is compared by its base with the low-pass, what lies beside by its colour.
        self._plane = np.where(self._own, 0, source_guide.size)
        self._guide = np.where(self._own, guide[row, column], tiles.guide[:, None])
        shown = np.where(self._own[..., None], _steps(base)[row, column], 0)
        self._shown = np.where(self._beside[..., None], _steps(colour)[row, column], shown)

    def cost(self, which: NDArray[np.intp], shift: NDArray[np.intp]) -> NDArray[np.int64]:
        """Return the cost of moving tiles `which`, (M,), by `shift`, (M, 2), neighbours aside.

        The mean squared difference of the base and of the sources' low-pass, over its own pixels
        that find a source; that of every other known pixel in the window around, over as many as a
        tile has or more; `NOT_KNOWN_COST` times the share of pixels without a source, and
        `FARTHER_COST` times that of sources which lie clearly behind.
        """
        place = (self._pixel[which] + shift[:, None].astype(np.int32) + 1).clip(0, self._size + 1)
        flat = place[..., 0] * self._stride + place[..., 1]
        nearer = self._guide[which] - self._source_guide[flat]
        source = nearer <= self._threshold
        own, beside = self._own[which], self._beside[which]
        off = self._shown[which] - self._sources[flat + self._plane[which]]
        error = np.einsum("tpc,tpc->tp", off, off)
        found = own & source
        pixels, sources = own.sum(axis=1), found.sum(axis=1)
        farther = (found & (-nearer > self._threshold)).sum(axis=1)
        compared = beside & source
        base_cost = (
            COST_SCALE * (error * found).sum(axis=1, dtype=np.int64) // np.maximum(sources, 1)
        )
        count = np.maximum(compared.sum(axis=1), (TILE_PX // WINDOW_STEP_PX) ** 2)
        return np.asarray(
            base_cost
            + COST_SCALE * (error * compared).sum(axis=1, dtype=np.int64) // count
            + COST_SCALE * NOT_KNOWN_COST * (pixels - sources) // np.maximum(pixels, 1)
            + COST_SCALE * FARTHER_COST * farther // np.maximum(pixels, 1)
        )

    def first_shifts(self) -> NDArray[np.intp]:
        """Return each tile's best shift along the parallax, from just past the hole on."""
        tiles = self.tiles
        every = np.arange(len(tiles.place))
        best, cost = np.zeros((len(every), 2), np.intp), np.full(len(every), WORSE)
        side = np.stack([-tiles.way[:, 1], tiles.way[:, 0]], axis=1)
        for length in range(LENGTHS):
            along = (tiles.way_px + 1 + length)[:, None] * tiles.way
            for aside in (0, *ASIDES_PX) if length % ASIDE_EVERY == 0 else (0,):
                shift = np.rint(along + aside * side).astype(np.intp)
                found = self.cost(every, shift)
                better = found < cost
                best[better], cost[better] = shift[better], found[better]
        return best

    def agree(self, shift: NDArray[np.intp], seed: int) -> NDArray[np.intp]:
        """Let tiles take neighbours' shifts, or random steps, where cost with disagreement falls.

        A sweep goes over the four classes of tiles with even and odd rows and columns, of which
        none are neighbours, so that the order within a class does not matter.
        """
        tiles, shift = self.tiles, shift.copy()
        cost = self.cost(np.arange(len(shift)), shift)
        for sweep in range(SWEEPS):
            for parity in range(4):
                which = np.flatnonzero((tiles.place % 2) @ (2, 1) == parity)
                if len(which):
                    shift[which], cost[which] = self._turn(which, shift, cost, sweep, seed)
        return shift

    def _turn(
        self,
        which: NDArray[np.intp],
        shift: NDArray[np.intp],
        cost: NDArray[np.int64],
        sweep: int,
        seed: int,
    ) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
        tiles = self.tiles
        row, column = (tiles.place[which] - tiles.first).T
        beside = [tiles.index[row + i, column + j] for i, j in NEIGHBOURS]
        best, best_cost = shift[which], cost[which]
        least = best_cost + self._disagreement(best, beside, shift)
        for k in range(len(NEIGHBOURS) + len(RANDOM_REACH_PX)):
            if k < len(NEIGHBOURS):
                offered = beside[k] >= 0
                proposed = shift[beside[k]]
            else:
                offered = np.ones(len(which), bool)
                reach = RANDOM_REACH_PX[k - len(NEIGHBOURS)]
                proposed = shift[which] + random_steps(tiles.place[which], sweep, k, seed, reach)
            offered &= (proposed != best).any(axis=1)
            some = np.flatnonzero(offered)
            if not len(some):
                continue
            own = self.cost(which[some], proposed[some])
            whole = own + self._disagreement(proposed[some], [b[some] for b in beside], shift)
            better = whole < least[some]
            at = some[better]
            best[at], best_cost[at], least[at] = proposed[at], own[better], whole[better]
        return best, best_cost

    @staticmethod
    def _disagreement(
        shift: NDArray[np.intp], beside: list[NDArray[np.intp]], all_shifts: NDArray[np.intp]
    ) -> NDArray[np.int64]:
        """Mean over neighbours of how far their shifts are off, `DISAGREEMENT_PX` at most."""
        far = [
            np.where(n >= 0, np.abs(all_shifts[n] - shift).sum(axis=1).clip(max=DISAGREEMENT_PX), 0)
            for n in beside
        ]
        count = np.maximum(sum((n >= 0).astype(np.int64) for n in beside), 1)
        scale = COST_SCALE * DISAGREEMENT_COST
        return np.asarray(scale * sum(far) // (DISAGREEMENT_PX * count))


def random_steps(
    place: NDArray[np.intp], sweep: int, turn: int, seed: int, reach_px: int
) -> NDArray[np.intp]:
    """Draw a step of up to `reach_px` for each tile; a hash, for it must not depend on others."""
    bits = hashed(place[:, 0], place[:, 1], sweep * 16 + turn, seed)
    span = np.uint32(2 * reach_px + 1)
    steps = np.stack([(bits & np.uint32(0xFFFF)) % span, (bits >> np.uint32(16)) % span], axis=1)
    return steps.astype(np.intp) - reach_px


def hashed(
    row: NDArray[np.integer], column: NDArray[np.integer], stream: int, seed: int
) -> NDArray[np.uint32]:
    """Mix whole numbers into 32 random bits (pcg3d of Jarzynski and Olano 2020, seeded)."""
    keys = [
        np.asarray(row).astype(np.int64).astype(np.uint32),
        np.asarray(column).astype(np.int64).astype(np.uint32),
        np.full(np.shape(row), stream, np.uint32),
    ]
    low, high = seed & 0xFFFFFFFF, seed >> 32
    salts = (low, high, low * 0x9E3779B9 & 0xFFFFFFFF)
    x, y, z = (key ^ np.uint32(salt) for key, salt in zip(keys, salts, strict=True))
    _, _, z = pcg3d(x, y, z)
    return np.asarray(z ^ (z >> np.uint32(16)), np.uint32)


def shifted(
    source: NDArray[np.float64],
    tiles: Tiles,
    shift: NDArray[np.intp],
    hole: NDArray[np.bool_],
    guide: NDArray[np.float64],
    flow_px: NDArray[np.float32],
    threshold: float,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Copy `source`, (H, W, n), into the holes; and tell where there was one, (H, W).

    Each pixel blends what the four tiles around it bring, by sharpened bilinear shares, so that
    tiles leave no edges. What different shifts bring is taken as uncorrelated, and the sum scaled
    to keep its variance. Holes, what lies outside and what is clearly nearer are no sources.
    """
    thick = tiles.label >= 0
    at = tile_coordinates(flow_px)[thick]
    pixel = np.argwhere(thick)
    shares, shifts = [], []
    total = np.zeros((len(at), source.shape[-1]))
    for offset in ((0, 0), (0, 1), (1, 0), (1, 1)):
        place = np.floor(at).astype(np.intp) + offset
        cell = (place - tiles.first).clip(0, np.array(tiles.index.shape) - 1)
        tile = tiles.index[cell[:, 0], cell[:, 1]]
        share = (1 - np.abs(at - place)).prod(axis=1) ** OVERLAP_POWER
        there = pixel + shift[tile]
        valid = (tile >= 0) & ((there >= 0) & (there < hole.shape)).all(axis=1)
        row, column = there.clip(0, np.array(hole.shape) - 1).T
        valid &= ~hole[row, column] & (guide[thick] - guide[row, column] <= threshold)
        shares.append(np.where(valid, share, 0.0))
        shifts.append(shift[tile])
        total += shares[-1][:, None] * source[row, column]
    power = sum(
        shares[i] * shares[j] * (shifts[i] == shifts[j]).all(axis=1)
        for i in range(4)
        for j in range(4)
    )
    some = np.asarray(power) > 0
    copied = np.zeros(source.shape)
    found = np.zeros(hole.shape, np.bool_)
    found[thick] = some
    copied[found] = total[some] / np.sqrt(power[some])[:, None]
    return copied, found


def _window() -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Pixels that a tile looks at, from its corner, (P, 2); and which serve for comparison, (P,).

    All that may be its own (motion within a tile differs by rounding), and every
    `WINDOW_STEP_PX`th of the window in both directions.
    """
    span = np.arange(-WINDOW_PX, TILE_PX + WINDOW_PX)
    pixel = np.stack(np.meshgrid(span, span, indexing="ij"), axis=-1).reshape(-1, 2)
    lattice = (pixel % WINDOW_STEP_PX == 0).all(axis=1)
    own = ((pixel >= -1) & (pixel <= TILE_PX)).all(axis=1)
    return pixel[lattice | own], lattice[lattice | own]


def _steps(colour: NDArray[np.float64]) -> NDArray[np.int32]:
    return np.rint(ENCODED_STEPS * colour).astype(np.int32)
