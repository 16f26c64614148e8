"""Filling holes by a map of shifts, in numpy.

What a hole uncovers goes on as what lies beside it. Its *base*, the smooth part, is half what
push-pull finds around, half the background's edge continued along the parallax. Its *detail* is
real: tiles of the hole are shifted onto the known background (Pritch et al. 2009, "Shift-map image
editing"), and what the background has there above a low-pass is copied, as much of it as the base
lacks.

Twin: gpu.py and its shaders. Change both or neither.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.frame import WarpedFrame, check_some_known
from pipeline.inpaint.reference import guide_from_depth
from pipeline.shiftmap.base import LUMA, Base, find_ways, smooth_base
from pipeline.shiftmap.settings import SQUARE_STEPS, ShiftMapSettings
from pipeline.shiftmap.tiles import (
    Blend,
    Search,
    Source,
    Tiles,
    blend_of,
    cut_tiles,
    grid_subpixels,
    planes_of,
    shifted,
)


@dataclass(frozen=True, eq=False)
class ShiftMapFill:
    """A fill and what led to it."""

    colour: NDArray[np.float64]  # (H, W, 3), the result, encoded, in [0, 1]
    base: Base
    detail: NDArray[np.float64]  # (H, W, 3), before its gain; 0 where there is no source
    gain: NDArray[np.float64]  # (H, W)
    tiles: Tiles
    shift: NDArray[np.intp]  # (N, 2) of the tiles, rows and columns


def shift_map_fill(
    warped: WarpedFrame, settings: ShiftMapSettings, *, z_near_m: float
) -> ShiftMapFill:
    """Fill the holes of `warped`.

    Parameters
    ----------
    z_near_m : float
        The clip's nearest depth, greater than 0.

    Raises
    ------
    InputError
        If every pixel is a hole.
    """
    check_some_known(warped.hole)
    hole, threshold = warped.hole, settings.depth_threshold
    guide = guide_from_depth(warped.depth_m, z_near_m)
    ways = find_ways(warped, guide, threshold)
    base = smooth_base(warped, guide, ways, threshold)

    planes = planes_of(hole, guide, base.colour, base.half_low)
    tiles = cut_tiles(base.wide > 0, planes.guide, warped.flow_px, ways)
    search = Search(tiles, planes, threshold)
    shift = search.agree(search.first_shifts())
    return lay_detail(warped, guide, base, tiles, shift, settings)


def lay_detail(
    warped: WarpedFrame,
    guide: NDArray[np.float64],
    base: Base,
    tiles: Tiles,
    shift: NDArray[np.intp],
    settings: ShiftMapSettings,
) -> ShiftMapFill:
    """Copy the detail that the tiles' shifts, (N, 2), lead to, as much as the base lacks."""
    hole, thick = warped.hole, base.wide > 0
    blend = blend_of(tiles, grid_subpixels(warped.flow_px)[thick])
    source = Source(base.colour - base.low, hole, guide, settings.depth_threshold)
    detail, gain = np.zeros(base.colour.shape), np.zeros(hole.shape)
    detail[thick] = shifted(source, np.argwhere(thick), blend, shift)
    lacks = lacking(base.detail[thick], detail[thick] @ LUMA, blend, len(shift))
    gain[thick] = settings.gain * base.wide[thick] * lacks
    filled = np.clip(base.colour + gain[..., None] * detail, 0.0, 1.0)
    result = np.where(hole[..., None], filled, warped.colour)
    return ShiftMapFill(result, base, detail, gain, tiles, shift)


def lacking(
    there: NDArray[np.float64], wanted: NDArray[np.float64], blend: Blend, tiles: int
) -> NDArray[np.float64]:
    """Tell which share of the detail the base lacks: (N,), 0 to 1.

    Variances of luma add up, so it is ``sqrt(1 - var(base's own detail) / var(detail))``, each
    summed over tiles, in whole steps, and interpolated between them.
    """
    squares = (np.rint(SQUARE_STEPS * values**2) for values in (there, wanted))
    sums = np.stack([np.bincount(blend.own, steps, minlength=tiles) for steps in squares])
    own, copied = (blend.share * np.where(blend.tile >= 0, sums[:, blend.tile], 0.0)).sum(axis=1)
    return np.asarray(np.sqrt(np.clip(1 - own / np.maximum(copied, 1.0), 0.0, 1.0)))
