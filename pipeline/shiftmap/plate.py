"""What was filled once stays: a plate in the source frame.

Fills of one source frame's views differ where the same place of the background is uncovered
again, and flicker. The plate keeps the colour that a place got when a view first uncovered it;
later views look it up, and only what is new keeps its own fill. So the fill of frame k follows from
the path's frames up to k with the same source, and from nothing else.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.frame import WarpedFrame

MARGIN_SHARE = 0.25  # of the frame's longer edge, around it: places further outside are not kept
CORNERS = ((0, 0), (0, 1), (1, 0), (1, 1))
READ_SHARE = 0.5  # a place counts as kept if texels of this bilinear share are
WRITE_SHARE = 0.3  # a texel is written if hole pixels of this bilinear share are near


class ShiftMapPlate:
    """The plate of one source frame.

    Parameters
    ----------
    depth_threshold : float
        Places whose depth differs by a larger share are of another surface, and are not taken.
    """

    def __init__(self, depth_threshold: float) -> None:
        self._threshold = depth_threshold
        self._colour = np.zeros((0, 0, 3))
        self._nearness = np.zeros((0, 0))
        self._kept = np.zeros((0, 0), np.bool_)
        self._margin = 0

    def settle(self, warped: WarpedFrame, filled: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return `filled` with what is kept in its holes, and keep what was new.

        Parameters
        ----------
        warped : WarpedFrame
            The next view of the source; all of them have one size.
        filled : ndarray of float32, shape (H, W, 3)
            Its own fill.
        """
        hole = warped.hole
        if not hole.any():
            return filled.copy()
        if not self._kept.size:
            self._begin(warped.size)
        pixel = np.argwhere(hole)
        motion = warped.flow_px[hole][:, ::-1].astype(np.float64)
        place = np.asarray(pixel - motion + self._margin, np.float64)
        nearness = np.asarray(1 / warped.depth_m[hole].astype(np.float64), np.float64)
        result = filled.astype(np.float64)
        share, colour = self._read(place, nearness)
        found = share > READ_SHARE
        result[hole] = np.where(found[:, None], colour, result[hole])
        self._keep(result, hole, pixel, place, nearness)
        shown = result.clip(0.0, 1.0).astype(np.float32)
        return np.where(hole[..., None], shown, warped.colour)

    def _begin(self, size: tuple[int, int]) -> None:
        self._margin = round(MARGIN_SHARE * max(size))
        shape = (size[0] + 2 * self._margin, size[1] + 2 * self._margin)
        self._colour = np.zeros((*shape, 3))
        self._nearness, self._kept = np.zeros(shape), np.zeros(shape, np.bool_)

    def _read(
        self, place: NDArray[np.float64], nearness: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Bilinear share of texels kept of the same surface, (N,), and their colour, (N, 3)."""
        total, summed = np.zeros(len(place)), np.zeros((len(place), 3))
        for texel, share in _around(place):
            at, inside = _within(texel, self._kept.shape)
            there = self._nearness[at]
            same = np.abs(there - nearness) <= self._threshold * np.maximum(there, nearness)
            share = np.where(inside & self._kept[at] & same, share, 0.0)
            total += share
            summed += share[:, None] * self._colour[at]
        return total, np.divide(
            summed, total[:, None], out=np.zeros_like(summed), where=total[:, None] > 0
        )

    def _keep(
        self,
        colour: NDArray[np.float64],
        hole: NDArray[np.bool_],
        pixel: NDArray[np.intp],
        place: NDArray[np.float64],
        nearness: NDArray[np.float64],
    ) -> None:
        """Write texels that have nothing yet, each from the hole pixels around its centre.

        A pixel writes the texel nearest to its place; of several the first in row order does.
        """
        texel = np.rint(place).astype(np.intp)
        at, inside = _within(texel, self._kept.shape)
        total, summed = np.zeros(len(texel)), np.zeros((len(texel), 3))
        for near, share in _around(pixel + (texel - place)):
            there, shown = _within(near, hole.shape)
            share = np.where(shown & hole[there], share, 0.0)
            total += share
            summed += share[:, None] * colour[there]
        new = np.flatnonzero(inside & ~self._kept[at] & (total > WRITE_SHARE))
        flat = np.ravel_multi_index((at[0][new], at[1][new]), self._kept.shape)
        new = new[np.unique(flat, return_index=True)[1]]
        here = at[0][new], at[1][new]
        self._colour[here] = summed[new] / total[new, None]
        self._nearness[here] = nearness[new]
        self._kept[here] = True


def _around(place: NDArray[np.float64]) -> list[tuple[NDArray[np.intp], NDArray[np.float64]]]:
    """The four whole places around each of (N, 2), and their bilinear shares."""
    first = np.floor(place).astype(np.intp)
    return [
        (first + corner, (1 - np.abs(place - first - corner)).prod(axis=1))
        for corner in np.array(CORNERS)
    ]


def _within(
    place: NDArray[np.intp], shape: tuple[int, ...]
) -> tuple[tuple[NDArray[np.intp], NDArray[np.intp]], NDArray[np.bool_]]:
    """Clamp whole places into an array; and tell which lay inside."""
    inside = np.asarray(((place >= 0) & (place < np.array(shape))).all(axis=1))
    clamped = place.clip(0, np.array(shape) - 1)
    return (clamped[:, 0], clamped[:, 1]), inside
