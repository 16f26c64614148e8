"""Moments of bands, which travel together, and what they stand for.

Noise that a hole lacks is what its statistics ask for, less what its base already holds: Kuffner
dos Anjos et al. 2022, 3.3 and 3.4, with the mends of docs/method.md.

Twin: lacking.comp.glsl. Change both or neither.
"""

import numpy as np

from pipeline.frame import Bools, Floats
from pipeline.inpaint.reference import GuidedLevel, children

SMALLEST_VARIANCE = 1e-12  # below it a band is empty and no slope can be measured
# A variance over the square of its mean magnitude, of a Laplace distribution, which photographs'
# bands nearly have (decision 0065). Means of squares would let a few edges make all the noise.
LAPLACE = 2.0
PER_BAND = 5


def moments(bands: Floats, *, cross: bool) -> Floats:
    """Make (H, W, bands, 3) into what is averaged: (H, W, bands * 5).

    Of luma itself, magnitude and square. Of each chroma the magnitude, or with `cross` the
    product with luma, so that colour can follow it.
    """
    luma, chroma = bands[..., :1], bands[..., 1:]
    of_chroma = luma * chroma if cross else np.abs(chroma)
    found = np.concatenate([luma, np.abs(luma), luma**2, of_chroma], axis=-1)
    return found.reshape(*bands.shape[:2], -1)


def luma_moments(values: Floats) -> tuple[Floats, Floats]:
    """Give mean and variance of luma, each (H, W, bands), by means of `moments`.

    The variance is ``LAPLACE (E|X|^2 - E[X]^2)``: a ramp is no texture.
    """
    mean, magnitude = np.moveaxis(_by_band(values)[..., :2], -1, 0)
    return mean, LAPLACE * np.maximum(0.0, magnitude**2 - mean**2)


def chroma_slopes(values: Floats) -> Floats:
    """Return slopes of chroma along luma, ``E[Y C] / E[Y^2]``: (H, W, bands, 2); with `cross`."""
    square, product = np.split(_by_band(values)[..., 2:], [1], axis=-1)
    measurable = square > SMALLEST_VARIANCE
    return np.divide(product, square, out=np.zeros_like(product), where=measurable)


def chroma_variances(values: Floats) -> Floats:
    """Give variances of chroma by itself: (H, W, bands, 2); without `cross`."""
    return np.asarray(LAPLACE * _by_band(values)[..., 3:] ** 2)


def _by_band(values: Floats) -> Floats:
    return values.reshape(*values.shape[:2], -1, PER_BAND)


# Share of known background around a texel from which on the base holds the whole band.
KNOWN_ENOUGH = 0.2


def noise_variances(
    values: Floats,
    base_bands: Floats,
    outlined: Bools,
    known: Floats,
    *,
    cross: bool,
) -> Floats:
    """Variance of the noise to add: what the statistics ask for and the base lacks.

    The base is not smooth. Its energy about the wanted mean is subtracted, over the 2x2
    coefficients that one set of statistics covers: ``max(0, var - mean((base - mu)^2))``. A
    coefficient across the outline of something nearer measures that outline. Beside one, the
    base is taken to hold ``known / KNOWN_ENOUGH`` of the variance, and all of it at most.

    With `cross`, chroma has its covariance with the luma noise: what luma lacks times the slope.

    Parameters
    ----------
    values : (H, W, 15)
        Inpainted moments.
    base_bands : (2 H, 2 W, bands, 3)
        The filled frame's; either edge may be one shorter.
    outlined : (2 H, 2 W) of bool
        Coefficients across a jump of depth.
    known : (H, W)
        See `known_background`.

    Returns
    -------
    ndarray of shape (H, W, 9)
        Of band b in channel c at index 3 * b + c.
    """
    mean, luma = luma_moments(values)
    variance = luma[..., None]
    if not cross:
        variance = np.concatenate([variance, chroma_variances(values)], axis=-1)
    about = children(base_bands)
    about[..., 0] -= mean[:, :, None]
    measured = (about**2).mean(axis=2)[..., : variance.shape[-1]]
    continued = variance * np.minimum(1.0, known / KNOWN_ENOUGH)[..., None, None]
    across = children(outlined[..., None].astype(np.float64)).max(axis=2)[..., None] > 0
    lacking = np.maximum(0.0, variance - np.where(across, continued, measured))
    if cross:
        lacking = np.concatenate([lacking, lacking * chroma_slopes(values)], axis=-1)
    return lacking.reshape(*values.shape[:2], -1)


def known_background(base: GuidedLevel, threshold: float) -> Floats:
    """Share of known background around each texel of the base, in a 3x3 binomial window.

    Confidence is the share of a texel's pixels that are known and of its depth. Neighbours
    that are nearer, by more than the threshold, count as unknown.
    """
    height, width = base.guide.shape
    share, guide = (
        np.pad(array, 1, mode="edge") for array in (np.maximum(0.0, base.validity), base.guide)
    )
    total = np.zeros((height, width))
    for row, down in enumerate((1, 2, 1)):
        for column, right in enumerate((1, 2, 1)):
            here = np.s_[row : row + height, column : column + width]
            total += down * right / 16 * share[here] * (base.guide - guide[here] <= threshold)
    return total
