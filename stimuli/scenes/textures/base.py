"""What surfaces are made of: noise, photographs that come with scikit-image, ramps of colour."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

Plane = NDArray[np.float64]
Colour = tuple[float, float, float]
Texture = NDArray[np.uint8]

SIZE_PX = 1024


def fractal(
    rng: np.random.Generator, size: int = SIZE_PX, slope: float = 1.2, coarsest: float = 2.0
) -> Plane:
    """Noise whose amplitude falls as frequency ** -slope; zero mean, unit variance, periodic.

    Waves longer than ``size / coarsest`` are left out, so that repeats do not show.
    """
    return noise(rng, size, slope, coarsest, 1.0)


def photograph(name: str, size: int = SIZE_PX) -> Plane:
    """One of scikit-image's grey photographs, made to repeat; zero mean, unit variance.

    Uneven light is taken out. The seam is hidden by fading into the picture shifted by
    half, as stones or blades end anywhere.
    """
    from skimage import data

    grey = np.asarray(getattr(data, name)(), np.float64)[:512, :512]
    grey = grey - ndimage.gaussian_filter(grey, 48, mode="reflect")
    shifted = np.roll(grey, (256, 256), (0, 1))
    ramp = np.minimum(np.arange(512), 511 - np.arange(512)) / 48.0
    weight = np.clip(np.minimum(ramp[:, None], ramp[None, :]), 0, 1)
    mixed = weight * grey + (1 - weight) * shifted
    mixed /= np.sqrt(weight**2 + (1 - weight) ** 2)  # two pictures averaged lose contrast
    if size > 512:
        mixed = np.tile(mixed, (size // 512, size // 512))
    elif size < 512:
        mixed = mixed.reshape(size, 512 // size, size, 512 // size).mean(axis=(1, 3))
    return np.asarray((mixed - mixed.mean()) / mixed.std())


def ramp(plane: Plane, colours: Sequence[Colour]) -> NDArray[np.float64]:
    """Colour by value: `plane` in [0, 1] along `colours` (encoded, 0 to 255)."""
    stops = np.linspace(0, 1, len(colours))
    table = np.asarray(colours, np.float64)
    return np.stack([np.interp(plane, stops, table[:, c]) for c in range(3)], axis=-1)


def finish(colour: NDArray[np.float64], coverage: Plane | None = None) -> Texture:
    """Round to bytes; where there is no coverage, colour goes on, so that edges do not fringe."""
    if coverage is None:
        alpha = np.full(colour.shape[:2], 255.0)
    else:
        alpha = 255 * coverage
        solid = coverage > 0.5
        if solid.any():
            nearest = ndimage.distance_transform_edt(
                ~solid, return_distances=False, return_indices=True
            )
            colour = np.where(solid[..., None], colour, colour[tuple(nearest)])
    rgba = np.concatenate([colour, alpha[..., None]], axis=-1)
    result: Texture = np.rint(rgba.clip(0, 255)).astype(np.uint8)
    return result


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
    waves = fft.rfft2(rng.standard_normal((size, size), np.float32)) * gain
    noise = fft.irfft2(waves, (size, size))
    return np.asarray((noise - noise.mean()) / noise.std(), np.float64)
