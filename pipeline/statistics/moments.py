"""Moments of bands, which travel together, and what they stand for."""

import numpy as np

from pipeline.frame import Floats

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
