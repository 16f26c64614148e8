"""Two rivals of the metamer that start from a blur: noise added to it, and contrast restored.

Noise: Tariq, Tursun and Didyk 2022, "Noise-based Enhancement for Foveated Rendering", ACM TOG
41(4). Between the finest detail that the eye resolves and the finest that it detects, at each
eccentricity, noise takes the place of what the blur took away. Its strength is foretold from the
blurred picture alone, by its contrast at the frequency where the blur begins to bite. Ours differs
in that noise is made of octave bands, not of Gabor kernels (so it has no orientation), that it is
worked out on encoded colour as everything here, and that no octave of it has more than twice the
variance of the picture's in the pool: of what is smooth, one frequency foretells too much.

Contrast: Patney, Salvi, Kim, Kaplanyan, Wyman, Benty, Luebke and Lefohn 2016, "Towards Foveated
Rendering for Gaze-Tracked Virtual Reality", ACM TOG 35(6). Around a wider mean, what the blur left
is amplified until local contrast is what it was (after Grundland et al. 2006).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.colour import ycbcr_from_rgb
from pipeline.foveation.chain import chain_length, chain_of, enlarge, halve_around, select
from pipeline.foveation.geometry import pixel_centres
from pipeline.foveation.pooled_moments import SMALLEST_VARIANCE
from pipeline.foveation.pooling import Pools, lod_of
from pipeline.foveation.reference import blurred, finished
from pipeline.foveation.sphere import noise_strength
from pipeline.frame import Floats
from pipeline.noise.tile import Stream, white_noise

# Tariq et al. 2022 after Thibos et al. 1987: by eccentricity, what gratings the eye resolves, and
# which it detects, cycles per degree.
LIMIT_ECCENTRICITIES_DEG = (0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0)
RESOLVED_CPD = (60.0, 27.0, 10.5, 8.0, 5.5, 4.8, 4.0, 3.0)
DETECTED_CPD = (60.0, 40.0, 26.0, 24.0, 23.0, 21.0, 20.5, 20.5)
BLUR_ENDS = 3.0  # deviations of a blur's frequency response beyond which nothing is left of it
ATTENUATION = 0.1  # amplitude that the blur leaves at the frequency whose contrast is measured
# Amplitude that it leaves of the octave around that frequency, where energy is even over octaves:
# the root of the mean of 0.1^(2 f^2), f from 2^-.5 to 2^.5.
OCTAVE_LEFT = 0.1528
MOST_OVER_OWN = math.sqrt(2)  # of noise's deviation over the picture's, in an octave
CONTRAST_WIDTH = 2.0  # width of the mean around which contrast is restored, over the blur's
MOST_CONTRAST = 4.0


def noise_enhanced(
    picture: NDArray[np.floating], pools: Pools, seed: int, *, strength: float
) -> NDArray[np.float32]:
    """Blur, and add noise of frequencies that are detected and not resolved: (H, W, 3)."""
    base = blurred(picture, pools)
    geometry = pools.geometry
    count = chain_length(geometry.width_px, geometry.height_px)
    luma = ycbcr_from_rgb(base)[..., :1].astype(np.float64)
    deviation = strength * contrast_at_cutoff(luma, pools, count) / OCTAVE_LEFT
    shares = octave_shares(pools, count)
    bands = octave_noise((geometry.height_px, geometry.width_px), count, seed, wraps=geometry.wraps)
    own = octave_deviations(ycbcr_from_rgb(picture)[..., :1].astype(np.float64), pools, count)
    amounts = [
        np.minimum(deviation * part, MOST_OVER_OWN * one)
        for part, one in zip(shares, own, strict=True)
    ]
    shape = np.sqrt(sum(amount**2 for amount in amounts))
    noise = sum(amount * band for amount, band in zip(amounts, bands, strict=True))
    # No more than the room that colour has: one deviation.
    room = np.minimum(base.min(axis=2), 1 - base.max(axis=2)).clip(0)
    noise = noise * np.minimum(1, room / np.maximum(shape, 1e-6))
    if geometry.on_sphere:
        noise *= noise_strength(geometry.directions(*pixel_centres(geometry)))
    return finished(picture, base + noise[..., None], pools)


def octave_noise(size: tuple[int, int], count: int, seed: int, *, wraps: bool) -> list[Floats]:
    """White noise split into `count` octaves, each (H, W) with variance 1."""
    chain = chain_of(white_noise(seed, size, 1, Stream.OCTAVES), count, wraps=wraps)
    octaves = []
    for level in range(count):
        band = chain[level] - enlarge(chain[level + 1], chain[level].shape[:2], 1, wraps=wraps)
        for finer in reversed(range(level)):
            band = enlarge(band, chain[finer].shape[:2], 1, wraps=wraps)
        octaves.append(band[..., 0] / max(1e-12, math.sqrt(float((band**2).mean()))))
    return octaves


def octave_shares(pools: Pools, count: int) -> list[Floats]:
    """Share of noise in each octave, from 1/2 cycle per pixel down: (H, W) each, 0 to 1."""
    eccentricity = pools.eccentricity_deg()
    density = pools.geometry.px_per_deg(*pixel_centres(pools.geometry))
    resolved, detected = (
        np.interp(eccentricity, LIMIT_ECCENTRICITIES_DEG, limits) / density
        for limits in (RESOLVED_CPD, DETECTED_CPD)
    )
    blur_ends = BLUR_ENDS / (2 * math.pi * np.maximum(pools.sigma_px(), 1e-9))
    low = np.log2(np.minimum(np.maximum(resolved, blur_ends), 0.5))
    high = np.log2(np.minimum(detected, 0.5))
    tops = [-1.0 - octave for octave in range(count)]
    return [
        np.sqrt(np.clip(np.minimum(high, top) - np.maximum(low, top - 1), 0, 1)) for top in tops
    ]


def contrast_at_cutoff(luma: Floats, pools: Pools, count: int) -> Floats:
    """Deviation of the octave around the frequency at which the blur leaves a tenth: (H, W)."""
    wraps = pools.geometry.wraps
    size = luma.shape[:2]
    chain = chain_of(luma, count, wraps=wraps)
    sigma_px = np.maximum(pools.sigma_px(), 1e-9)
    cutoff = math.sqrt(-2 * math.log(ATTENUATION)) / (2 * math.pi * sigma_px)
    octave = np.clip(np.log2(0.5 / np.minimum(cutoff, 0.5)) - 0.5, 0, count - 1)
    variance = np.zeros(size)
    for level in range(count):
        share = np.clip(1 - np.abs(octave - level), 0, 1)
        if not share.any():
            continue
        local = _octave_variance(chain, level, wraps=wraps)
        variance += share * enlarge(local, size, level + 1, wraps=wraps)[..., 0]
    return np.sqrt(variance)


def octave_deviations(luma: Floats, pools: Pools, count: int) -> list[Floats]:
    """Deviation of each of `count` octaves of (H, W, 1) in the pools, finest first: (H, W)."""
    wraps, size = pools.geometry.wraps, luma.shape[:2]
    chain = chain_of(luma, count, wraps=wraps)

    def deviation(level: int) -> Floats:
        local = _octave_variance(chain, level, wraps=wraps)
        variances = chain_of(local, count - level - 1, wraps=wraps)
        pooled = select(variances, lambda n: pools.lod(level + n, level), first=1, wraps=wraps)
        return np.asarray(np.sqrt(enlarge(pooled, size, level + 1, wraps=wraps)[..., 0]))

    return [deviation(level) for level in range(count)]


def _octave_variance(chain: Sequence[Floats], level: int, *, wraps: bool) -> Floats:
    """Around each texel one halving coarser, for zero crossings are no lack of contrast."""
    fine = chain[level]
    octave = fine - enlarge(chain[level + 1], fine.shape[:2], 1, wraps=wraps)
    return halve_around(octave**2, wraps=wraps)


def contrast_enhanced(
    picture: NDArray[np.floating], pools: Pools, *, strength: float
) -> NDArray[np.float32]:
    """Blur, and amplify what is left until luma varies locally as it did: (H, W, 3)."""
    base = blurred(picture, pools)
    wraps = pools.geometry.wraps
    count = chain_length(pools.geometry.width_px, pools.geometry.height_px)

    def wide(values: Floats) -> Floats:
        return select(
            chain_of(values, count, wraps=wraps),
            lambda halvings: lod_of(CONTRAST_WIDTH * pools.sigma_px(halvings)),
            wraps=wraps,
        )

    def moments(image: Floats) -> tuple[Floats, Floats]:
        luma = ycbcr_from_rgb(image)[..., :1].astype(np.float64)
        pooled = wide(np.concatenate([image, luma, luma**2], axis=2))
        return pooled[..., :3], np.maximum(pooled[..., 4:] - pooled[..., 3:4] ** 2, 0)

    mean, left = moments(base)
    _, wanted = moments(picture.astype(np.float64))
    ratio = np.sqrt((wanted + SMALLEST_VARIANCE) / (left + SMALLEST_VARIANCE))
    gain = 1 + strength * (np.clip(ratio, 1, MOST_CONTRAST) - 1)
    return finished(picture, mean + gain * (base - mean), pools)
