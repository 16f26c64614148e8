"""Metameric inpainting from end to end, as the paper has it, in numpy.

Kuffner dos Anjos et al. 2022, sections 3.2 to 3.4. docs/method.md says where this goes
its own way and what was measured.

Twin: gpu.py with composite.comp.glsl. Change both or neither.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.colour import rgb_from_ycbcr, ycbcr_from_rgb
from pipeline.features.reference import analyse
from pipeline.frame import Floats, WarpedFrame, check_seed, check_some_known
from pipeline.inpaint.reference import GuidedLevel, guide_from_depth, guided_base, guided_mean
from pipeline.noise.tile import NoiseBands, look_up, noise_bands
from pipeline.statistics.reference import inpainted_statistics
from pipeline.synthesis.settings import ANCHOR_REACH_PX, MetamericSettings

SMALLEST_LACKING = 1e-20  # below it what is lacking is no more divided by its own root


@dataclass(frozen=True, eq=False)
class MetamericFill:
    """A metameric fill and what led to it."""

    colour: Floats  # (H, W, 3), the result, encoded, in [0, 1]
    base: Floats  # (H, W, 3), before the noise
    anchor_px: Floats  # (H, W, 2), where each pixel's noise is looked up
    statistics: tuple[GuidedLevel, ...]  # per level, at half its size: inpainted moments
    lacking: tuple[
        GuidedLevel, ...
    ]  # per level, at half its size: (H, W, 9), see `noise_variances`


def metameric_fill(
    warped: WarpedFrame,
    settings: MetamericSettings,
    *,
    seed: int,
    z_near_m: float,
) -> MetamericFill:
    """Fill the holes of `warped` with a metamer of its background.

    Parameters
    ----------
    seed : int
        Of the noise, from 0 to 2**63 - 1.
    z_near_m : float
        The clip's nearest depth, greater than 0.

    Raises
    ------
    InputError
        If every pixel is a hole, or the seed is none.
    """
    seed = check_seed(seed)
    check_some_known(warped.hole)
    guide = guide_from_depth(warped.depth_m, z_near_m)
    base_levels = guided_base(
        warped.colour,
        warped.hole,
        guide,
        levels=settings.levels,
        gamma=settings.gamma,
        threshold=settings.depth_threshold,
    )
    hole = warped.hole[..., None]
    base = np.where(hole, base_levels[0].values, warped.colour)
    return with_detail(warped, base, base_levels, settings, seed=seed)


def with_detail(
    warped: WarpedFrame,
    base: Floats,
    base_levels: list[GuidedLevel],
    settings: MetamericSettings,
    *,
    seed: int,
    parts: Sequence[Floats] | None = None,
    attention: Floats | float = 1.0,
) -> MetamericFill:
    """Add the noise that a filled frame, `base`, lacks, or a share of it, `attention` (H, W, 1).

    `base_levels` are push-pull's, for their depth; `parts` as of `inpainted_statistics`.
    """
    statistics, lacking = inpainted_statistics(
        analyse(ycbcr_from_rgb(base), settings.levels).bands,
        warped.hole,
        base_levels,
        cross=settings.channels == "correlated",
        gamma=settings.gamma,
        threshold=settings.depth_threshold,
        skip_depth_edges=settings.skip_depth_edges,
        parts=parts,
    )
    anchor_px = _anchors(warped, settings)
    noise = shaped_noise(
        lacking,
        base_levels[0].guide,
        anchor_px,
        noise_bands(seed, settings.levels, 1 if settings.channels == "correlated" else 3),
        settings.depth_threshold,
    )
    filled = np.clip(base + settings.noise * attention * rgb_from_ycbcr(noise), 0.0, 1.0)
    colour = np.where(warped.hole[..., None], filled, warped.colour)
    return MetamericFill(colour, base, anchor_px, tuple(statistics), tuple(lacking))


def deviations(lacking: Floats, *, cross: bool) -> Floats:
    """Amplitude of the noise from its variance, (..., 3 channels).

    Variances are interpolated before their root is taken: the deviation falls to nothing at
    a hole's border, and the mean of deviations would lack up to half of the energy.
    """
    if not cross:
        return np.sqrt(lacking)
    return np.asarray(lacking / np.sqrt(np.maximum(lacking[..., :1], SMALLEST_LACKING)))


def shaped_noise(
    lacking: list[GuidedLevel],
    guide: Floats,
    anchor_px: Floats,
    noise: NoiseBands,
    threshold: float,
) -> Floats:
    """Sum all bands' noise, weighted pixel by pixel: (H, W, 3), Y', Cb, Cr.

    Chroma that follows luma has luma's noise.
    """
    total = np.zeros((*guide.shape, 3))
    channels = noise.tiles.shape[1]
    for level, coarse in enumerate(lacking):
        variance = sample(coarse, guide, level + 1, threshold)
        variance = variance.reshape(*guide.shape, 3, 3)
        texel = look_up(noise, level, anchor_px)  # (H, W, bands, 1 or 3)
        total += (deviations(variance, cross=channels == 1) * texel).sum(axis=2)
    return total


def sample(coarse: GuidedLevel, guide: Floats, resolution: int, threshold: float) -> Floats:
    """Interpolate a level of `resolution` at all full-size pixels, guided by depth."""
    (*rows, fy), (*columns, fx) = (
        _taps(length, coarse.guide.shape[axis], resolution)
        for axis, length in enumerate(guide.shape)
    )
    along_y, along_x = np.stack([1 - fy, fy], axis=-1), np.stack([1 - fx, fx], axis=-1)
    shares = along_y[:, None, :, None] * along_x[None, :, None, :]
    return guided_mean(coarse, rows, columns, shares, guide, threshold)[0]


def _taps(
    length: int, coarse_length: int, resolution: int
) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats]:
    place = (np.arange(length) + 0.5) / (1 << resolution) - 0.5
    first = np.floor(place).astype(np.intp)
    last = coarse_length - 1
    return np.clip(first, 0, last), np.clip(first + 1, 0, last), place - first


def _anchors(warped: WarpedFrame, settings: MetamericSettings) -> Floats:
    height, width = warped.size
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    here = np.stack([x, y], axis=-1)
    if settings.anchor == "screen":
        return here
    place = here - warped.flow_px.astype(np.float64)
    seen = (np.abs(place) < ANCHOR_REACH_PX).all(axis=-1)
    return np.where(seen[..., None], place, here)
