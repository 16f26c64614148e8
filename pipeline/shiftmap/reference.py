"""Filling holes by a map of shifts, in numpy.

What a hole uncovers goes on as what lies beside it. Its *base*, the smooth part, is half what
push-pull finds around, half the background's edge continued along the parallax. Its *detail* is
real: tiles of the hole are shifted onto the known background (Pritch et al. 2009, "Shift-map image
editing"), and what the background has there above a low-pass is copied, as much of it as the base
lacks.

There is no twin on the GPU yet: docs/decisions/0067.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.colour import YCBCR_FROM_RGB
from pipeline.frame import WarpedFrame, check_some_known
from pipeline.inpaint.reference import (
    RELAXED_RESOLUTIONS,
    Level,
    guide_from_depth,
    pull_push,
)
from pipeline.shiftmap.base import find_ways, smooth_base
from pipeline.shiftmap.lowpass import surface_lowpass
from pipeline.shiftmap.settings import (
    DETAIL_SIGMA_PX,
    VARIANCE_SIGMA_PX,
    ShiftMapSettings,
)
from pipeline.shiftmap.tiles import Search, Tiles, cut_tiles, hashed, shifted
from pipeline.synthesis.settings import check_seed

LUMA = YCBCR_FROM_RGB[0]
NOISE_STREAM = 1 << 16  # of the hash: the search uses those below
SOFTENING = (0.25, 0.5, 0.25)  # of the noise: real detail is strongest at a few pixels
LEAST_VARIANCE = 1e-6  # below this detail is none, and what it lacks has no meaning


@dataclass(frozen=True, eq=False)
class ShiftMapFill:
    """A fill and what led to it."""

    colour: NDArray[np.float64]  # (H, W, 3), the result, encoded, in [0, 1]
    base: NDArray[np.float64]  # (H, W, 3)
    detail: NDArray[np.float64]  # (H, W, 3), before its gain
    gain: NDArray[np.float64]  # (H, W)
    copied: NDArray[np.bool_]  # (H, W), detail that has a source; elsewhere it is noise
    tiles: Tiles
    shift: NDArray[np.intp]  # (N, 2) of the tiles, rows and columns


def shift_map_fill(
    warped: WarpedFrame, settings: ShiftMapSettings, *, seed: int, z_near_m: float
) -> ShiftMapFill:
    """Fill the holes of `warped`.

    Parameters
    ----------
    seed : int
        Of the search's random steps and of the noise, from 0 to 2**63 - 1.
    z_near_m : float
        The clip's nearest depth, greater than 0.

    Raises
    ------
    InputError
        If every pixel is a hole, or the seed is none.
    """
    seed = check_seed(seed)
    check_some_known(warped.hole)
    hole, threshold = warped.hole, settings.depth_threshold
    guide = guide_from_depth(warped.depth_m, z_near_m)
    colour = np.where(hole[..., None], 0.0, warped.colour.astype(np.float64))
    ways = find_ways(warped, threshold)
    base, wide = smooth_base(warped, guide, ways, threshold)

    low = surface_lowpass(colour, ~hole, guide, DETAIL_SIGMA_PX, threshold)
    known_detail = np.where(hole[..., None], 0.0, colour - low)
    thick = hole & (wide > 0)
    tiles = cut_tiles(thick, guide, warped.flow_px, ways.of(thick[hole]))
    search = Search(tiles, hole, guide, colour, base, low, threshold)
    shift = search.agree(search.first_shifts(), seed)
    copied, found = shifted(known_detail, tiles, shift, hole, guide, warped.flow_px, threshold)
    noise = shaped_noise(known_detail, hole, guide, warped.flow_px, seed, threshold)
    detail = np.where(found[..., None], copied, noise)

    gain = settings.gain * wide * lacking(base, detail, hole, guide, threshold)
    filled = np.clip(base + gain[..., None] * detail, 0.0, 1.0)
    result = np.where(hole[..., None], filled, warped.colour)
    return ShiftMapFill(result, base, detail, gain, found, tiles, shift)


def lacking(
    base: NDArray[np.float64],
    detail: NDArray[np.float64],
    hole: NDArray[np.bool_],
    guide: NDArray[np.float64],
    threshold: float,
) -> NDArray[np.float64]:
    """Tell which share of the detail the base lacks: (H, W), 0 to 1.

    Variances of luma add up, so it is ``sqrt(1 - var(base's own detail) / var(detail))``.
    """
    own = base - surface_lowpass(base, hole, guide, DETAIL_SIGMA_PX, threshold)
    squares = np.stack([own @ LUMA, detail @ LUMA], axis=-1) ** 2
    there, wanted = np.moveaxis(
        surface_lowpass(squares, hole, guide, VARIANCE_SIGMA_PX, threshold), -1, 0
    )
    return np.asarray(np.sqrt(np.clip(1 - there / np.maximum(wanted, LEAST_VARIANCE), 0.0, 1.0)))


def shaped_noise(
    known_detail: NDArray[np.float64],
    hole: NDArray[np.bool_],
    guide: NDArray[np.float64],
    flow_px: NDArray[np.float32],
    seed: int,
    threshold: float,
) -> NDArray[np.float64]:
    """Grey noise as strong as the detail around, for holes without a source: (H, W, 3).

    A hash of the place in the source frame, so that it moves with the background; its
    deviation is carried into the hole by push-pull.
    """
    luma = known_detail @ LUMA
    level = Level((luma**2)[..., None], (~hole).astype(np.float64), guide)
    pushed = pull_push(level, 0.0, threshold, RELAXED_RESOLUTIONS)
    deviation = np.sqrt(np.maximum(pushed[0].values[..., 0], 0.0))
    pixel = np.moveaxis(np.indices(hole.shape), 0, -1)
    texel = np.floor(pixel + 0.5 - flow_px[..., ::-1].astype(np.float64)).astype(np.int64)
    return np.asarray((deviation * soft_noise(texel, seed))[..., None].repeat(3, axis=-1))


def soft_noise(texel: NDArray[np.int64], seed: int) -> NDArray[np.float64]:
    """Noise of unit variance at whole places (..., 2): a hash of each, smoothed by [1 2 1] / 4."""
    total = np.zeros(texel.shape[:-1])
    for i, across in zip((-1, 0, 1), SOFTENING, strict=True):
        for j, along in zip((-1, 0, 1), SOFTENING, strict=True):
            bits = hashed(texel[..., 0] + i, texel[..., 1] + j, NOISE_STREAM, seed)
            total += across * along * (bits.astype(np.float64) / 2**32 - 0.5)
    return np.asarray(np.sqrt(12.0) / sum(share**2 for share in SOFTENING) * total)
