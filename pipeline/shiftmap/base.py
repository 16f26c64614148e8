"""The smooth part of a shift-map fill: push-pull and the background's edge, continued."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.frame import WarpedFrame
from pipeline.inpaint.reference import guided_base
from pipeline.shiftmap.lowpass import surface_lowpass
from pipeline.shiftmap.settings import (
    DETAIL_SIGMA_PX,
    EXTENSION_SHARE,
    SPREAD,
    THIN_PX,
    WIDE_PX,
)
from pipeline.synthesis.settings import MetamericSettings
from pipeline.walks import Scene, background_ends, parallax_direction, walk_to_known, walk_within

EDGE_INSET_PX = 1  # past the mixed colours of a silhouette


@dataclass(frozen=True, eq=False)
class Ways:
    """From each of the N hole pixels, row by row, to its end on the background's side."""

    pixel: NDArray[np.intp]  # (N, 2), row and column
    step: NDArray[np.float64]  # (N, 2), from pixel to pixel; the longer part is 1
    steps: NDArray[np.intp]  # (N,), to the first known pixel
    end: NDArray[np.intp]  # (N, 2), the pixel whose colour goes on
    across_px: NDArray[np.float64]  # (N,), how wide the hole is along the way

    def of(self, some: NDArray[np.bool_]) -> "Ways":
        """Those of some of the pixels, (N,)."""
        return Ways(
            self.pixel[some],
            self.step[some],
            self.steps[some],
            self.end[some],
            self.across_px[some],
        )


def find_ways(warped: WarpedFrame, threshold: float) -> Ways:
    """Walk from every hole pixel to the background's side, and once the other way."""
    hole = warped.hole
    scene = Scene(~hole, warped.depth_m, threshold)
    pixel = np.argwhere(hole)
    found = background_ends(scene, pixel, parallax_direction(warped, threshold)[hole])
    inset = np.full(len(pixel), EDGE_INSET_PX)
    end = walk_within(scene, found.end, found.step, inset)
    back = walk_to_known(~hole, pixel, -found.step)
    # A hole that is open behind is as wide as the way ahead says, and half as much again.
    behind = np.where(back.found, back.steps - 1, WIDE_PX)
    return Ways(pixel, found.step, found.steps, end, (found.steps + behind).astype(np.float64))


def wideness(
    hole: NDArray[np.bool_], ways: Ways, guide: NDArray[np.float64], threshold: float
) -> NDArray[np.float64]:
    """Tell how far holes are from thin: 0 up to `THIN_PX` across, 1 from `WIDE_PX` on, (H, W)."""
    share = np.zeros(hole.shape)
    share[hole] = np.clip((ways.across_px - THIN_PX) / (WIDE_PX - THIN_PX), 0.0, 1.0)
    smooth = surface_lowpass(share[..., None], hole, guide, DETAIL_SIGMA_PX, threshold)[..., 0]
    return np.where(hole, smooth, 0.0)


def across(
    values: NDArray[np.float64],
    hole: NDArray[np.bool_],
    ways: Ways,
    guide: NDArray[np.float64],
    threshold: float,
) -> NDArray[np.float64]:
    """Average the ends of ways side by side, the farther the end the more of them; (N, n).

    A Gaussian across the way whose deviation is `SPREAD` of the steps to the end: what lies beside
    the background's edge goes on sharp, and leaves no streaks deep in the hole. Ends of another
    surface do not count. Beside the hole a known pixel is its own end.
    """
    height, width = hole.shape
    end_of = np.moveaxis(np.indices((height, width)), 0, -1).copy()
    end_of[hole] = ways.end
    own = guide[ways.end[:, 0], ways.end[:, 1]]
    aside = np.stack([-ways.step[:, 1], ways.step[:, 0]], axis=1)
    sigma_px = SPREAD * ways.steps
    reach = np.floor(2 * sigma_px + 0.5).astype(np.intp)
    total, weight = np.zeros((len(own), values.shape[-1])), np.zeros(len(own))
    for k in range(-int(reach.max(initial=0)), int(reach.max(initial=0)) + 1):
        some = np.flatnonzero(reach >= abs(k))
        place = np.rint(ways.pixel[some] + k * aside[some]).astype(np.intp)
        within = ((place >= 0) & (place < hole.shape)).all(axis=1)
        some, place = some[within], place[within]
        end = end_of[place[:, 0], place[:, 1]]
        same = np.abs(guide[end[:, 0], end[:, 1]] - own[some]) <= threshold
        share = np.where(same, np.exp(-0.5 * (k / np.maximum(sigma_px[some], 0.3)) ** 2), 0.0)
        total[some] += share[:, None] * values[end[:, 0], end[:, 1]]
        weight[some] += share
    return total / weight[:, None]  # its own end always counts


def smooth_base(
    warped: WarpedFrame, guide: NDArray[np.float64], ways: Ways, threshold: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fill the holes smoothly: (H, W, 3); and how far holes are from thin, (H, W).

    Half of it is what push-pull finds around the hole at its depth, half the background's edge
    continued along the parallax. Thin holes are filled by push-pull alone.
    """
    hole = warped.hole
    colour = np.where(hole[..., None], 0.0, warped.colour.astype(np.float64))
    pushed = guided_base(
        colour,
        hole,
        guide,
        levels=MetamericSettings.levels,
        gamma=MetamericSettings.gamma,
        threshold=threshold,
    )[0].values
    wide = wideness(hole, ways, guide, threshold)
    share = EXTENSION_SHARE * wide[hole][:, None]
    base = colour.copy()
    low = surface_lowpass(colour, ~hole, guide, DETAIL_SIGMA_PX, threshold)
    extended = across(low, hole, ways, guide, threshold)
    base[hole] = (1 - share) * pushed[hole] + share * extended
    return base, wide
