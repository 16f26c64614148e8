"""Place of a pixel of one frame some frames later, by the motion that files tell."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pipeline.frame import SourceFrame
from stimuli.media.channels import Motion

DEPTH_TOLERANCE = 0.1
"""Largest difference of a surface from frame to frame, as a share of its nearness."""


def followed(
    first: int,
    last: int,
    frame: Callable[[int], SourceFrame],
    motion: Callable[[int], Motion],
) -> NDArray[np.float32]:
    """Follow every pixel of frame `first` to frame `last`, by the nearest pixel's motion.

    Parameters
    ----------
    frame, motion : callable
        Picture and motion of a frame by its index. Where motion leads to the previous frame,
        the way from one frame to the next is that of the next one, turned round.

    Returns
    -------
    ndarray of float32, shape (H, W, 2)
        Target minus source position in pixels, x then y.
    """
    height, width = frame(first).size
    y, x = np.mgrid[:height, :width].astype(np.float64)
    at_x, at_y = x.copy(), y.copy()
    for step in range(first, last):
        told = motion(step)
        if told.to_previous:
            step_px = turned_round(motion(step + 1).flow_px, frame(step + 1), frame(step))
        else:
            step_px = told.flow_px
        row = np.rint(at_y).astype(int).clip(0, height - 1)
        column = np.rint(at_x).astype(int).clip(0, width - 1)
        at_x, at_y = at_x + step_px[row, column, 0], at_y + step_px[row, column, 1]
    return np.stack([at_x - x, at_y - y], axis=-1).astype(np.float32)


def turned_round(
    back_px: NDArray[np.float32], later: SourceFrame, earlier: SourceFrame
) -> NDArray[np.float32]:
    """Return the motion from `earlier` to `later`, given the one from `later` back.

    Each pixel of `later` names the pixel of `earlier` that it came from; of several, the
    nearest surface counts, and none that differs in depth from what is there. What `later`
    does not see takes the motion of the pixel of nearest depth among the closest ones to its
    left, right, top and bottom.
    """
    height, width = later.size
    y, x = np.mgrid[:height, :width]
    row = np.rint(y + back_px[..., 1].astype(np.float64)).astype(int)
    column = np.rint(x + back_px[..., 0].astype(np.float64)).astype(int)
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    nearness, there = 1.0 / later.depth_m, 1.0 / earlier.depth_m
    seen = there[row.clip(0, height - 1), column.clip(0, width - 1)]
    same = np.abs(nearness - seen) <= DEPTH_TOLERANCE * np.maximum(nearness, seen)
    chosen = np.flatnonzero(inside & same)
    chosen = chosen[np.argsort(nearness.ravel()[chosen], kind="stable")]  # the nearest last
    target = row.ravel()[chosen] * width + column.ravel()[chosen]
    flow = np.zeros((height * width, 2), np.float32)
    known = np.zeros(height * width, bool)
    flow[target], known[target] = -back_px.reshape(-1, 2)[chosen], True
    return _completed(flow.reshape(height, width, 2), known.reshape(height, width), there)


def _completed(
    flow: NDArray[np.float32], known: NDArray[np.bool_], nearness: NDArray[np.float32]
) -> NDArray[np.float32]:
    best = np.full(known.shape, np.inf)
    result = flow.copy()
    for axis in (0, 1):
        for turn in (False, True):
            index = _last_known(np.flip(known, axis) if turn else known, axis)
            if turn:
                index = np.flip(index, axis)
                index = np.where(index >= 0, known.shape[axis] - 1 - index, -1)
            take = index.clip(0)
            near = np.take_along_axis(nearness, take, axis)
            apart = np.where(index >= 0, np.abs(near - nearness), np.inf)
            better = ~known & (apart < best)
            best = np.where(better, apart, best)
            moved = np.take_along_axis(flow, np.repeat(take[..., None], 2, -1), axis)
            result[better] = moved[better]
    return result


def _last_known(known: NDArray[np.bool_], axis: int) -> NDArray[np.int64]:
    """Index along `axis` of the last true entry up to each place, -1 before the first."""
    count = known.shape[axis]
    shape = (count, 1) if axis == 0 else (1, count)
    index = np.where(known, np.arange(count).reshape(shape), -1)
    return np.maximum.accumulate(index, axis=axis)
