"""The noise of the printed method: white noise through the pyramid's filters, twice.

Kuffner dos Anjos et al. 2022, 3.4. "Scaled to {-1, 1}" is taken as unit variance of every band's
coefficients: else a deviation would mean nothing. A coefficient map is not an image: each band
passes its filter again and is brought up to full size (Walton et al. 2021, 3.4).
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.features.reference import analyse, band, double, fitted_kernels
from pipeline.noise.tile import white_noise

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
