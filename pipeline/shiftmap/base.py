"""The smooth part of a shift-map fill: push-pull and the background's edge, continued."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.background_texture.reference import OCTANTS, Scene, at, background_border, rays
from pipeline.colour import YCBCR_FROM_RGB
from pipeline.frame import WarpedFrame
from pipeline.inpaint.reference import Level, guided_base, guided_mean
from pipeline.shiftmap.settings import (
    EXTENSION_SHARE,
    LOW_RESOLUTION,
    NEARER_SHARE,
    THIN_PX,
    WAY_REACH_PX,
    WIDE_PX,
)
from pipeline.synthesis.settings import MetamericSettings

LUMA = YCBCR_FROM_RGB[0]


@dataclass(frozen=True, eq=False)
class Ways:
    """From each of the N hole pixels, row by row, to its end on the background's side."""

    pixel: NDArray[np.intp]  # (N, 2), row and column
    step: NDArray[np.intp]  # (N, 2), from pixel to pixel: -1, 0 or 1
    steps: NDArray[np.intp]  # (N,), to the first pixel beyond; 0: the background is out of reach
    end: NDArray[np.intp]  # (N, 2), the pixel whose colour goes on
    # (N,), how wide the hole is along the way, at most the reach; `WIDE_PX` if it is enclosed.
    across_px: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Base:
    """What detail is laid upon."""

    colour: NDArray[np.float64]  # (H, W, 3), the holes filled smoothly
    low: NDArray[np.float64]  # (H, W, 3), the low-pass of push-pull's fill
    half_low: NDArray[np.float64]  # (H / 2, W / 2, 3), the same in the middle of 2x2 pixels
    wide: NDArray[np.float64]  # (H, W), 0 where a hole is thin or none, 1 where it is not
    detail: NDArray[np.float64]  # (H, W), luma that the base itself has above a low-pass


def find_ways(warped: WarpedFrame, guide: NDArray[np.float64], threshold: float) -> Ways:
    """Walk from every hole pixel to the background's side, and the other way to the hole's end.

    From a hole that only nearer things surround, and that is not thin, the way goes through them.
    """
    scene = Scene(~warped.hole, guide, warped.flow_px[..., ::-1].astype(np.float64), threshold)
    pixel = np.argwhere(warped.hole)
    border, towards, found = background_border(scene, pixel, WAY_REACH_PX)
    step = np.where(found[:, None], towards, 0)
    steps = np.where(found, np.abs(border - pixel).max(axis=1, initial=0), 0)
    behind = _hole_pixels_behind(warped.hole, pixel, step)
    across_px = np.where(found, np.minimum(steps + behind, WAY_REACH_PX), 0)

    enclosed = np.flatnonzero(~found)
    narrowest_px = _narrowest_px(rays(scene.known, pixel[enclosed], WIDE_PX)[0])
    enclosed = enclosed[narrowest_px >= WIDE_PX]
    step[enclosed], steps[enclosed] = _through(scene, pixel[enclosed], towards[enclosed])
    across_px[enclosed] = np.where(steps[enclosed] > 0, WIDE_PX, 0)

    border = np.asarray(pixel + steps[:, None] * step, np.intp)
    # Past the mixed colours of a silhouette, where what comes next is background too.
    inset = scene.is_background(border + step, pixel)
    return Ways(pixel, step, steps, border + inset[:, None] * step, across_px)


def _through(
    scene: Scene, pixel: NDArray[np.intp], towards: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Find the nearest known pixel of hole pixels' own surface along the parallax, past all else.

    Returns step, (N, 2), and steps, (N,).
    """
    found, steps = np.zeros(pixel.shape, np.intp), np.zeros(len(pixel), np.intp)
    own = at(scene.guide, pixel)
    for step in (towards, -towards):
        walking = np.flatnonzero(step.any(axis=1))
        for count in range(1, WAY_REACH_PX + 1):
            place = pixel[walking] + count * step[walking]
            inside = ((place >= 0) & (place < scene.known.shape)).all(axis=1)
            inside &= (steps[walking] == 0) | (count < steps[walking])
            walking, place = walking[inside], place[inside]
            apart = np.abs(own[walking] - at(scene.guide, place))
            met = at(scene.known, place) & (apart <= scene.threshold)
            ended, walking = walking[met], walking[~met]
            found[ended], steps[ended] = step[ended], count
    return found, steps


def _hole_pixels_behind(
    hole: NDArray[np.bool_], pixel: NDArray[np.intp], step: NDArray[np.intp]
) -> NDArray[np.intp]:
    """How many come next the other way, `WIDE_PX` more where the hole is open behind."""
    count = np.zeros(len(pixel), np.intp)
    walking = np.flatnonzero(step.any(axis=1))
    for k in range(1, WAY_REACH_PX + 1):
        place = pixel[walking] - k * step[walking]
        outside = ((place < 0) | (place >= hole.shape)).any(axis=1)
        count[walking[outside]] += WIDE_PX
        walking = walking[~outside & at(hole, place)]
        count[walking] = k
    return count


def lowpass(
    quarters: Level, guide: NDArray[np.float64], resolution: int, threshold: float
) -> NDArray[np.float64]:
    """Interpolate means of 4x4 pixels, those of one's own surface: (H, W, 3).

    `guide`, (H, W), is that of a resolution: 0 for every pixel, 1 for the middle of 2x2.
    """
    edge = 1 << (LOW_RESOLUTION - resolution)
    taps, shares = [], []
    for length, coarse in zip(guide.shape, quarters.guide.shape, strict=True):
        first, part = np.divmod(2 * np.arange(length) - (edge - 1), 2 * edge)
        taps.append([(first + i).clip(0, coarse - 1) for i in (0, 1)])
        shares.append(np.stack([2.0 * edge - part, part], axis=-1))
    weight = shares[0][:, None, :, None] * shares[1][None, :, None, :]
    return guided_mean(quarters, taps[0], taps[1], weight, guide, threshold)[0]


def across(
    values: NDArray[np.float64],
    hole: NDArray[np.bool_],
    ways: Ways,
    guide: NDArray[np.float64],
    threshold: float,
) -> NDArray[np.float64]:
    """Average what ways side by side have, the longer the way the more of them; (N, n).

    `values`, (N, n), are the ways' own. A tent across the way that reaches half as far as the end
    lies: what is beside the background's edge goes on sharp, and leaves no streaks deep in the
    hole. Ways to another surface do not count. Zero where there is no way.
    """
    index = np.full(hole.shape, -1, np.intp)
    index[hole] = np.arange(len(ways.pixel))
    own = guide[ways.end[:, 0], ways.end[:, 1]]
    aside = np.stack([-ways.step[:, 1], ways.step[:, 0]], axis=1)
    reach = ways.steps // 2
    total, weight = np.zeros(values.shape), np.zeros(len(own))
    most = int(reach.max(initial=0))
    for k in range(-most, most + 1):
        some = np.flatnonzero((reach >= abs(k)) & (ways.steps > 0))
        place = ways.pixel[some] + k * aside[some]
        inside = ((place >= 0) & (place < hole.shape)).all(axis=1)
        there = at(index, place)
        same = inside & (there >= 0) & (ways.steps[there] > 0)
        same &= np.abs(own[there] - own[some]) <= threshold
        share = np.where(same, reach[some] + 1 - abs(k), 0)
        total[some] += share[:, None] * values[there]
        weight[some] += share
    return total / np.maximum(weight, 1)[:, None]


def nearer_around(
    warped: WarpedFrame, pixel: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Tell what hole pixels may show instead, whose background is in sight nowhere.

    Between leaves a narrow gap uncovers another leaf as often as what lies behind them all.

    Parameters
    ----------
    pixel : (N, 2)
        Those without a way.

    Returns
    -------
    colour : (N, 3)
        Mean of where the eight rays end, nearer ends counting more; all of it is in front.
    share : (N,)
        Of the base. Zero where the hole is wide along its row and its column.
    """
    steps, end = rays(~warped.hole, pixel, WAY_REACH_PX)
    met = steps > 0
    step_px = np.sqrt((np.array(OCTANTS) ** 2).sum(axis=1))[:, None]
    weight = np.where(met, 1 / (step_px * np.maximum(steps, 1)), 0.0)
    total = np.where(met.any(axis=0), weight.sum(axis=0), 1.0)
    colour = (weight[..., None] * at(warped.colour, end)).sum(axis=0) / total[:, None]
    return colour, NEARER_SHARE * (1 - _thickness(_narrowest_px(steps)))


def _narrowest_px(steps: NDArray[np.intp]) -> NDArray[np.intp]:
    """How wide holes are along rows or columns, at most `WIDE_PX`; `steps`, (8, N), of `rays`.

    Diagonals do not count: they are short in every corner.
    """
    one, other = steps[[0, 2]], steps[[4, 6]]
    across_px = np.where((one > 0) & (other > 0), one + other - 1, WIDE_PX)
    return np.asarray(across_px.min(axis=0).clip(max=WIDE_PX))


def _thickness(across_px: NDArray[np.intp]) -> NDArray[np.float64]:
    """Tell how far from thin a hole is: 0 up to `THIN_PX` across, 1 from `WIDE_PX` on."""
    return np.clip((across_px - THIN_PX) / (WIDE_PX - THIN_PX), 0.0, 1.0)


def smooth_base(
    warped: WarpedFrame, guide: NDArray[np.float64], ways: Ways, threshold: float
) -> Base:
    """Fill the holes smoothly.

    Half of it is what push-pull finds around the hole at its depth, half the low-pass of the
    background's edge continued along the parallax. Thin holes are filled by push-pull alone, but
    for a share of what is nearer where the background is in sight nowhere.
    """
    hole = warped.hole
    colour = np.where(hole[..., None], 0.0, warped.colour.astype(np.float64))
    levels = guided_base(
        colour, hole, guide, levels=1, gamma=MetamericSettings.gamma, threshold=threshold
    )
    pushed = np.where(hole[..., None], levels[0].values, colour)
    low = lowpass(levels[LOW_RESOLUTION], guide, 0, threshold)
    halves = lowpass(levels[LOW_RESOLUTION], levels[1].guide, 1, threshold)
    thickness = _thickness(ways.across_px)
    own = np.concatenate([low[ways.end[:, 0], ways.end[:, 1]], thickness[:, None]], axis=1)
    extended = across(own, hole, ways, guide, threshold)
    share = EXTENSION_SHARE * extended[:, 3:]
    base, wide, detail = pushed.copy(), np.zeros(hole.shape), np.zeros(hole.shape)
    base[hole] = (1 - share) * pushed[hole] + share * extended[:, :3]
    enclosed = ways.pixel[ways.steps == 0]
    nearer, nearer_share = nearer_around(warped, enclosed)
    base[tuple(enclosed.T)] += nearer_share[:, None] * (nearer - base[tuple(enclosed.T)])
    wide[hole] = extended[:, 3]
    detail[hole] = (1 - share[:, 0]) * ((pushed - low)[hole] @ LUMA)
    return Base(base, low, halves, wide, detail)
