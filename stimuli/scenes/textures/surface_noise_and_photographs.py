"""Parts of textures: noise, photographs that come with scikit-image, ramps of colour."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft, ndimage

Plane = NDArray[np.float64]
PaintedColour = NDArray[np.float64]
"""Shape (N, N, 3); it lies in memory channel by channel, which makes what is done to it fast."""
Rgb = tuple[float, float, float]
ByteTexture = NDArray[np.uint8]

SIZE_PX = 1024


def fractal(
    rng: np.random.Generator, size: int = SIZE_PX, slope: float = 1.2, coarsest: float = 2.0
) -> Plane:
    """Noise whose amplitude falls as frequency ** -slope; zero mean, unit variance, periodic.

    Waves longer than ``size / coarsest`` are left out, so that repeats do not show.
    """
    return noise(rng, size, slope, coarsest, 1.0)


def photograph(name: str) -> Plane:
    """One of scikit-image's grey photographs, made to repeat; zero mean, unit variance.

    Uneven light is taken out. The seam is hidden by fading into the picture shifted by
    half, as stones or blades end anywhere.
    """
    from skimage import data

    grey = np.asarray(getattr(data, name)(), np.float64)[:512, :512]
    grey = grey - cosine_blurred(grey, 48.0)
    shifted = np.roll(grey, (256, 256), (0, 1))
    ramp = np.minimum(np.arange(512), 511 - np.arange(512)) / 48.0
    weight = np.clip(np.minimum(ramp[:, None], ramp[None, :]), 0, 1)
    mixed = weight * grey + (1 - weight) * shifted
    mixed /= np.sqrt(weight**2 + (1 - weight) ** 2)  # two pictures averaged lose contrast
    mixed = np.tile(mixed, (SIZE_PX // 512, SIZE_PX // 512))
    return np.asarray((mixed - mixed.mean()) / mixed.std())


def ramp(plane: Plane, colours: Sequence[Rgb]) -> PaintedColour:
    """Colour by value: `plane` in [0, 1] along `colours` (encoded, 0 to 255)."""
    table = np.asarray(colours, np.float64)
    step = 1 / (len(table) - 1)
    result = shaded(np.diff(table, axis=0)[0] / step, np.clip(plane, 0, step))
    for index, rise in enumerate(np.diff(table, axis=0)[1:] / step, 1):
        result += shaded(rise, np.clip(plane - index * step, 0, step))
    result += table[0]
    return result


def shaded(tone: ArrayLike, value: Plane) -> PaintedColour:
    """Return the colour `tone` times each of `value`."""
    channel = np.asarray(tone, np.float64).reshape(3, *(1,) * value.ndim)
    return np.moveaxis(channel * value, 0, -1)


def finish(colour: PaintedColour, coverage: Plane | None = None) -> ByteTexture:
    """Round to bytes; where there is no coverage, colour goes on, so that edges do not fringe."""
    rgba = np.empty((*colour.shape[:2], 4), np.uint8)
    for channel in range(3):
        rgba[..., channel] = _rounded(colour[..., channel])
    rgba[..., 3] = 255
    if coverage is None:
        return rgba
    solid = coverage >= 0.5
    if solid.any():
        nearest = ndimage.distance_transform_edt(
            ~solid, return_distances=False, return_indices=True
        )
        rgba = rgba[tuple(nearest)]
    rgba[..., 3] = _rounded(255 * coverage)
    return rgba


def _rounded(plane: Plane) -> Plane:
    within = np.clip(plane, 0, 255)
    return np.rint(within, out=within)


def cosine_blurred(plane: Plane, sigma: float) -> Plane:
    """Gaussian blur of a square, reflected at its edges: a product for a cosine transform.

    The kernel ends at four times `sigma`, as scipy's does.
    """
    reach = np.arange(1, round(4 * sigma) + 1)
    weights = np.exp(-0.5 * (reach / sigma) ** 2)
    waves = np.cos(np.outer(np.pi * np.arange(len(plane)) / len(plane), reach))
    gain = (1 + 2 * waves @ weights) / (1 + 2 * weights.sum())
    return np.asarray(fft.idctn(fft.dctn(plane) * np.outer(gain, gain)))


def stretched(rng: np.random.Generator, size: int, ratio: float) -> Plane:
    """Noise drawn out along v; unit variance, periodic."""
    return noise(rng, size, 0.95, 3.0, ratio)


def noise(
    rng: np.random.Generator, size: int, slope: float, coarsest: float, ratio: float
) -> Plane:
    """White noise, shaped in the frequency domain; single precision, for speed."""
    fx = (fft.rfftfreq(size)[None, :] * size).astype(np.float32)
    fy = (fft.fftfreq(size)[:, None] * size * ratio).astype(np.float32)
    squared = fx**2 + fy**2
    gain = np.maximum(squared, 1.0) ** np.float32(-slope / 2)
    gain[squared < coarsest**2] = 0.0
    waves = fft.rfft2(rng.standard_normal((size, size), np.float32), overwrite_x=True)
    waves *= gain
    noise = fft.irfft2(waves, (size, size), overwrite_x=True)
    noise -= noise.mean()
    noise /= noise.std()
    return np.asarray(noise, np.float64)
