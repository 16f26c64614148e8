"""Metameric inpainting as printed, in numpy.

Kuffner dos Anjos et al. 2022 ([MI]), sections 3.2 to 3.4 and Alg. 1, and nothing else. Where the
text contradicts itself it is read as docs/method.md says: depth grows with distance, so the
background is the *farthest*; the pull divides by its weights; `mix` takes its operands in order;
the variance is ``E[X^2] - E[X]^2``. The pyramid is the one of `pipeline.features`.

Noise is white noise through the pyramid's filters, twice (3.4). "Scaled to {-1, 1}" is taken as
unit variance of every band's coefficients: else a deviation would mean nothing. A coefficient map
is not an image: each band passes its filter again and is brought up to full size (Walton et al.
2021, 3.4).

Twin: gpu.py with *.comp.glsl. Change both or neither.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.colour import rgb_from_ycbcr, ycbcr_from_rgb
from pipeline.errors import InputError
from pipeline.features.reference import (
    Pyramid,
    analyse,
    band,
    check_levels,
    double,
    fitted_kernels,
    grow,
    halve,
    synthesise,
)
from pipeline.frame import Floats, Ints, WarpedFrame, check_seed, check_some_known
from pipeline.inpaint.reference import GuidedLevel, children, guide_from_depth, pull
from pipeline.noise.tile import white_noise
from pipeline.pushpull.reference import upsample
from pipeline.synthesis.settings import ANCHOR_REACH_PX


@dataclass(frozen=True)
class PrintedSettings:
    """Parameters of `metameric-paper`; the defaults are the paper's own.

    Parameters
    ----------
    levels : int
        Pyramid levels, 1 to 6 (section 4).
    gamma : float
        Exponent on validity in the push: 0 most local, 1 smoothest (3.3.1).
    depth_threshold : float
        Children nearer than the farthest by more than this, in ``1 - z_near / z``, do not count
        in the pull (the authors' release).

    Raises
    ------
    InputError
        If a value is out of range.
    """

    levels: int = 4
    gamma: float = 0.5
    depth_threshold: float = 0.04

    def __post_init__(self) -> None:
        check_levels(self.levels)
        if not 0 <= self.gamma <= 8:
            raise InputError(f"gamma must lie in 0..8 (got {self.gamma})")
        if not 0 < self.depth_threshold <= 1:
            raise InputError(f"depth_threshold must lie in (0, 1] (got {self.depth_threshold})")


TILE = 256  # edge of the tile, pixels; a power of two


@lru_cache(maxsize=2)
def printed_noise(seed: int, levels: int) -> NDArray[np.float32]:
    """Make the noise of one seed; the same on every platform; read-only.

    Returns
    -------
    ndarray of float32, shape (levels, TILE, TILE, 3 bands, 3 channels)
        Full-size images of each band alone, periodic; channels are independent.
    """
    white = white_noise(seed, (TILE, TILE), 3)
    # As far as the filters of the coarsest level reach, there and back.
    pad = 4 << levels
    periodic = np.pad(white, ((pad, pad), (pad, pad), (0, 0)), mode="wrap")
    kernels = fitted_kernels()
    bands = analyse(periodic, levels, kernels).bands
    images = []
    for level, coefficients in enumerate(bands):
        inner = slice(pad >> level, (pad + TILE) >> level)
        rms = np.sqrt((coefficients[inner, inner] ** 2).mean(axis=(0, 1)))
        unit = coefficients / rms
        ready = []
        for index, kernel in enumerate(kernels.bands()):
            image = band(unit[:, :, index], kernel[::-1, ::-1])
            for finer in reversed(range(level)):
                image = double(image, bands[finer].shape[:2], kernels)
            ready.append(image[pad : pad + TILE, pad : pad + TILE])
        images.append(np.stack(ready, axis=2))
    noise = np.stack(images).astype(np.float32)
    noise.flags.writeable = False
    return noise


PARTLY = -1.0  # state of what is known in part


@dataclass(frozen=True, eq=False)
class PrintedFill:
    """A fill and what led to it; level k has shape (ceil(H / 2^k), ceil(W / 2^k), ...)."""

    colour: Floats  # (H, W, 3), the result, encoded, in [0, 1]
    means: tuple[Floats, ...]  # (..., 3 bands, 3 channels)
    deviations: tuple[Floats, ...]  # the same
    residual: Floats  # Y', Cb, Cr


def printed_fill(
    warped: WarpedFrame, settings: PrintedSettings, *, seed: int, z_near_m: float
) -> PrintedFill:
    """Fill the holes of `warped`: ``mu_l + sum mu_ij + xi_ij sigma_ij`` ([MI] 3.4).

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
    threshold, levels = settings.depth_threshold, settings.levels
    colour = warped.colour.astype(np.float64)
    low = np.asarray(ycbcr_from_rgb(colour), np.float64)
    state = np.where(warped.hole, 0.0, 1.0)
    guide = guide_from_depth(warped.depth_m, z_near_m)
    pulled = GuidedLevel(low, state, guide)
    means, deviations = [], []
    for _ in range(levels):
        pulled = pull(pulled, threshold)
        valid = (~grow(state < 1, 1)).astype(np.float64)
        values = inpainted(
            GuidedLevel(features(low, state), valid, guide), settings.gamma, threshold
        )
        mean, square = np.split(values.reshape(*values.shape[:2], -1, 6), 2, axis=-1)
        means.append(mean)
        # 3.3.1 prints the sign reversed.
        deviations.append(np.sqrt(np.maximum(square - mean**2, 0.0)))
        low, state, guide = half(low, state, guide)
    residual = inpainted(residual_level(low, state, pulled), settings.gamma, threshold)
    image = synthesise(Pyramid(tuple(means), residual))
    noise = printed_noise(seed, levels)
    row, column = noise_texels(warped.flow_px)
    for level in range(levels):
        shape = at_pixels(deviations[level], warped.size, level)
        image = image + (shape * noise[level][row, column]).sum(axis=2)
    filled = np.clip(rgb_from_ycbcr(image), 0.0, 1.0)
    colour = np.where(warped.hole[..., None], filled, warped.colour)
    return PrintedFill(colour, tuple(means), tuple(deviations), residual)


def features(low: Floats, state: Floats) -> Floats:
    """Measure a level's bands and their squares, band by band: (H, W, 3 bands * 6).

    What reaches a hole is not valid, and counts for nothing ([MI] 3.2, Fig. 7).
    """
    clean = np.where(state[..., None] != 0, low, 0.0)
    bands = np.stack([band(clean, kernel) for kernel in fitted_kernels().bands()], axis=2)
    return np.concatenate([bands, bands**2], axis=-1).reshape(*bands.shape[:2], -1)


def half(low: Floats, state: Floats, guide: Floats) -> tuple[Floats, Floats, Floats]:
    """Low-pass and halve what is known, by normalised convolution ([MI] 3.2).

    `state` is 1 where a pixel is known, 0 where nothing is, and `PARTLY` where some of what it
    covers is. A pixel of the next level is known if all four that it covers are; its depth is the
    farthest of theirs.
    """
    weight = (state != 0).astype(np.float64)[..., None]
    covered = children(state[..., None])[..., 0]
    some = (covered != 0).any(axis=2)
    ahead = np.where((covered == 1).all(axis=2), 1.0, np.where(some, PARTLY, 0.0))
    mean = halve(weight * low) / np.where(some[..., None], halve(weight), 1.0)
    farthest = children(guide[..., None]).max(axis=2)[..., 0]
    return np.where(some[..., None], mean, 0.0), ahead, farthest


def residual_level(low: Floats, state: Floats, pulled: GuidedLevel) -> GuidedLevel:
    """Return the residual to be inpainted: the low-pass where all of it is known.

    Elsewhere it would mix the foreground in, and at this resolution whole holes would vanish. There
    stands what Alg. 1 has `pulled` from the colours of the hole's own depth, with its validity.
    """
    whole = state == 1
    values = np.where(whole[..., None], low, pulled.values)
    return GuidedLevel(values, np.where(whole, 1.0, pulled.validity), pulled.guide)


def inpainted(level: GuidedLevel, gamma: float, threshold: float) -> Floats:
    """Pull to 1x1 and push back ([MI] Alg. 1).

    Where the farthest of all is nowhere known, what is nearer stands in at validity 0, so that it
    serves where the picture has nothing else; printed it would be black.
    """
    levels = [level]
    while levels[-1].validity.shape != (1, 1):
        levels.append(pull(levels[-1], threshold))
    values = levels.pop().values
    while levels:
        values = push(levels.pop(), values, gamma)
    return values


def push(fine: GuidedLevel, below: Floats, gamma: float) -> Floats:
    """Complete `fine` with the coarser `below`: ``mix(below, fine, validity ** gamma)``."""
    known = fine.validity > 0
    share = np.where(known, np.abs(fine.validity) ** gamma, 0.0)[..., None]
    coarse = upsample(below, (fine.guide.shape[0], fine.guide.shape[1]))
    return np.asarray(share * fine.values + (1 - share) * coarse)


def noise_texels(flow_px: NDArray[np.float32]) -> tuple[Ints, Ints]:
    """Row and column of each pixel's noise: the nearest texel to where it came from (3.4.1).

    In float32 as the twin, so that both round alike. Beyond `ANCHOR_REACH_PX` noise stays on the
    screen.
    """
    height, width, _ = flow_px.shape
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    here = np.stack([x, y], axis=-1) + np.float32(0.5)
    place = here - flow_px
    seen = (np.abs(place) < np.float32(ANCHOR_REACH_PX)).all(axis=-1, keepdims=True)
    texel = np.floor(np.where(seen, place, here)).astype(np.int64) % TILE
    return texel[..., 1], texel[..., 0]


def at_pixels(values: Floats, size: tuple[int, int], level: int) -> Floats:
    """Interpolate a level bilinearly at the centres of full-size pixels, borders repeated."""
    result = values
    for axis, length in enumerate(size):
        place = (np.arange(length) + 0.5) / (1 << level) - 0.5
        first = np.floor(place).astype(np.int64)
        last = values.shape[axis] - 1
        share = (place - first).reshape((-1,) + (1,) * (values.ndim - 1 - axis))
        near = result.take(np.clip(first, 0, last), axis)
        far = result.take(np.clip(first + 1, 0, last), axis)
        result = (1 - share) * near + share * far
    return result
