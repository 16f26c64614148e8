"""Plate in the source frame: what was filled once stays.

Fills of one source frame's views differ where the same place of the background is uncovered
again, and flicker. The plate keeps the colour that a place got when a view first uncovered it;
later views look it up, take it for known, and fill only the rest. So the fill of frame k follows
from the path's frames up to k with the same source, and from nothing else.

Places, shares and kept colours are whole numbers, so that both twins have the same bits.
Twin: gpu.py with recall.comp.glsl, show.comp.glsl and keep.comp.glsl. Change both or neither.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.frame import Bools, Floats, Ints, WarpedFrame

SUBPIXELS = 256  # motion is taken in so many parts of a pixel, as the warp gives it

MARGIN_SHARE = 0.25  # of the frame's longer edge, around it: places further outside are not kept
CORNERS = ((0, 0), (0, 1), (1, 0), (1, 1))
WHOLE = SUBPIXELS**2  # bilinear shares sum to this
READ_SHARE = WHOLE // 2  # a place counts as kept if texels of more of its share are
WRITE_SHARE = 3 * WHOLE // 10  # a texel is written if hole pixels of more of its share are near
COLOUR_STEPS = 1 << 15  # of a kept colour: a share of it fits 32 bits


def margin_px(size: tuple[int, int]) -> int:
    """Margin of the plate beyond a frame of `size`, pixels."""
    return round(MARGIN_SHARE * max(size))


class KeptFills:
    """Fills of one source frame's views: what is kept counts as known, and the rest is filled.

    Parameters
    ----------
    fill : function of a WarpedFrame, weights, (H, W), and a seed
        Returns its own fill, (H, W, 3). What is known weighs 1, what is kept `weight`, holes 0.
    depth_threshold : float
        As of `SourcePlate`.
    overwrites : bool
        Whether each view replaces what is kept in its holes.
    """

    def __init__(
        self,
        fill: Callable[[WarpedFrame, Floats, int], NDArray[np.float32]],
        depth_threshold: float,
        *,
        weight: float = 1.0,
        overwrites: bool = False,
    ) -> None:
        self._fill, self._weight, self._overwrites = fill, weight, overwrites
        self._plate = SourcePlate(depth_threshold)

    def fill(self, warped: WarpedFrame, seed: int = 0) -> NDArray[np.float32]:
        """Fill the next view; all of them have one size."""
        hole = warped.hole
        if not hole.any():
            return warped.colour
        kept, colour = self._plate.recall(warped)
        known, weight = warped.colour.copy(), (~hole).astype(np.float64)
        known[hole] = np.where(kept[:, None], colour, np.float32(0))
        weight[hole] = np.where(kept, self._weight, 0.0)
        filled = self._fill(replace(warped, colour=known, hole=weight == 0), weight, seed)
        shown = np.where(hole[..., None], filled, warped.colour)
        self._plate.keep(warped, shown, again=self._overwrites)
        return shown


class SourcePlate:
    """The plate of one source frame.

    Parameters
    ----------
    depth_threshold : float
        Places whose depth differs by a larger share of the greater one are of another surface, and
        are not taken.
    """

    def __init__(self, depth_threshold: float) -> None:
        self._same = np.float32(1 - depth_threshold)
        self._colour: Ints = np.zeros((0, 0, 3), np.int64)
        self._depth_m = np.zeros((0, 0), np.float32)  # 0: nothing is kept
        self._margin = 0

    def recall(self, warped: WarpedFrame) -> tuple[Bools, NDArray[np.float32]]:
        """Mask of a view's hole pixels, (N,), filled before; and their colours, (N, 3)."""
        if not self._depth_m.size:
            self._begin(warped.size)
        _, place = self._places(warped)
        share, steps = self._read(place, warped.depth_m[warped.hole])
        return share > READ_SHARE, (steps / COLOUR_STEPS).astype(np.float32)

    def keep(self, warped: WarpedFrame, shown: NDArray[np.float32], *, again: bool = False) -> None:
        """Keep what a view shows in its holes: where nothing was kept, or `again` everywhere."""
        pixel, place = self._places(warped)
        self._keep(shown, warped.hole, pixel, place, warped.depth_m[warped.hole], again=again)

    def _places(self, warped: WarpedFrame) -> tuple[Ints, Ints]:
        """Hole pixels, (N, 2), and where they lie in the plate, in parts of a pixel."""
        pixel = np.argwhere(warped.hole)
        motion = np.rint(SUBPIXELS * warped.flow_px[warped.hole][:, ::-1]).astype(np.int64)
        return pixel, SUBPIXELS * (pixel + self._margin) - motion

    def _begin(self, size: tuple[int, int]) -> None:
        self._margin = margin_px(size)
        shape = (size[0] + 2 * self._margin, size[1] + 2 * self._margin)
        self._colour, self._depth_m = np.zeros((*shape, 3), np.int64), np.zeros(shape, np.float32)

    def _read(self, place: Ints, depth_m: NDArray[np.float32]) -> tuple[Ints, Ints]:
        """Bilinear share of texels kept of the same surface, (N,), and their colour, (N, 3)."""
        total, summed = np.zeros(len(place), np.int64), np.zeros((len(place), 3), np.int64)
        for texel, share in _around(place):
            at, inside = _within(texel, self._depth_m.shape)
            there = self._depth_m[at]
            same = np.minimum(there, depth_m) >= self._same * np.maximum(there, depth_m)
            share = np.where(inside & (there > 0) & same, share, 0)
            total += share
            summed += share[:, None] * self._colour[at]
        return total, _divided(summed, total)

    def _keep(
        self,
        colour: NDArray[np.float32],
        hole: Bools,
        pixel: Ints,
        place: Ints,
        depth_m: NDArray[np.float32],
        *,
        again: bool,
    ) -> None:
        """Write texels that may be written, each from the hole pixels around its centre.

        A pixel writes the texel nearest to its place; of several the first in row order does.
        """
        texel = (place + SUBPIXELS // 2) // SUBPIXELS
        at, inside = _within(texel, self._depth_m.shape)
        total, summed = np.zeros(len(texel), np.int64), np.zeros((len(texel), 3), np.int64)
        steps = np.rint(COLOUR_STEPS * colour).astype(np.int64)
        for near, share in _around(SUBPIXELS * (pixel + texel) - place):
            there, shown = _within(near, hole.shape)
            share = np.where(shown & hole[there], share, 0)
            total += share
            summed += share[:, None] * steps[there]
        free = again | (self._depth_m[at] == 0)
        new = np.flatnonzero(inside & free & (total > WRITE_SHARE))
        flat = np.ravel_multi_index((at[0][new], at[1][new]), self._depth_m.shape)
        new = new[np.unique(flat, return_index=True)[1]]
        here = at[0][new], at[1][new]
        self._colour[here] = _divided(summed[new], total[new])
        self._depth_m[here] = depth_m[new]


def _divided(summed: Ints, total: Ints) -> Ints:
    """Divide (N, 3) by (N,) to the nearest whole number."""
    whole = np.maximum(total, 1)[:, None]
    return np.asarray((summed + whole // 2) // whole)


def _around(place: Ints) -> list[tuple[Ints, Ints]]:
    """The four texels around each of (N, 2) places in parts of a pixel, and their shares."""
    first = place // SUBPIXELS
    return [
        (
            first + corner,
            (SUBPIXELS - abs(SUBPIXELS * (first + corner) - place)).prod(axis=1),
        )
        for corner in np.array(CORNERS)
    ]


def _within(
    place: Ints, shape: tuple[int, ...]
) -> tuple[tuple[NDArray[np.intp], NDArray[np.intp]], Bools]:
    """Clamp whole places into an array; and tell which lay inside."""
    inside = np.asarray(((place >= 0) & (place < np.array(shape))).all(axis=1))
    clamped = place.clip(0, np.array(shape) - 1)
    return (clamped[:, 0], clamped[:, 1]), inside
