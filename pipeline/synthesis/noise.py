"""Tileable noise, split by the pyramid and brought back to full size, band by band.

Kuffner dos Anjos et al. 2022, 3.4: white noise passes the same filters as the image.
"Scaled to {-1, 1}" must mean unit variance per band for a deviation to mean anything; and
a coefficient map is not an image: each band passes its filter again and is brought up to
full size (Walton et al. 2021, 3.4). Both are done here, once per seed. What is left to do
per frame is to weigh the bands, for deviations vary slowly against the kernels.

All bands come from the same white noise, so that equal weights give white noise back:
weighing is a graphic equaliser.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.features.reference import Kernels, analyse, band, double, fitted_kernels

TILE = 256  # edge of the tile, pixels; a power of two
LAGS = ((0, 1), (1, 0), (1, 1), (1, -1))  # (row, column)


@dataclass(frozen=True, eq=False)
class NoiseBands:
    """One seed's noise.

    `tiles`: (levels, channels, TILE, TILE, 3 bands); `lag_correlation`:
    (levels, 3 bands, 4 lags of `LAGS`), see `lag_correlation`.
    """

    tiles: NDArray[np.float32]
    lag_correlation: NDArray[np.float32]


@lru_cache(maxsize=2)
def noise_bands(seed: int, levels: int, channels: int) -> NoiseBands:
    """Make the noise of one seed; the same on every platform. Its arrays are read-only.

    Every band of a tile is scaled so that its coefficients have unit variance.
    """
    # Philox's raw bits are specified; a library's normal deviates might change.
    uniform = np.random.Philox(key=seed).random_raw(TILE * TILE * channels)
    white = ((uniform >> 11).astype(np.float64) * 2.0**-53 - 0.5) * np.sqrt(12.0)
    white = white.reshape(TILE, TILE, channels)
    periodic = np.pad(white, ((TILE // 2,) * 2,) * 2 + ((0, 0),), mode="wrap")
    kernels = fitted_kernels()
    pyramid = analyse(periodic, levels, kernels)
    tiles = np.stack([_level(pyramid.bands, level, kernels) for level in range(levels)])
    noise = NoiseBands(tiles.astype(np.float32), lag_correlation(tiles, white))
    for array in (noise.tiles, noise.lag_correlation):
        array.flags.writeable = False
    return noise


def lag_correlation(
    tiles: NDArray[np.floating], white: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Correlation of neighbouring texels, (levels, 3 bands, len(LAGS)), over whole tiles.

    Half of it is a band's with itself, half its with `white`, (TILE, TILE, channels), which
    all bands sum to. The first alone would hold each band's variance between texels, and let
    that of their sum rise by 15 %, for bands overlap; the second alone lets it sink by 8 %.
    """
    exact = tiles.astype(np.float64)
    whole = np.moveaxis(white, -1, 0)[None, ..., None]

    def lagged(other: NDArray[np.floating]) -> NDArray[np.float64]:
        def mean(rows: int, columns: int) -> NDArray[np.float64]:
            shifted = np.roll(other, (-rows, -columns), axis=(2, 3))
            return np.asarray((exact * shifted).mean(axis=(1, 2, 3)))

        both_ways = [0.5 * (mean(rows, columns) + mean(-rows, -columns)) for rows, columns in LAGS]
        return np.stack(both_ways, axis=-1) / mean(0, 0)[..., None]

    return (0.5 * (lagged(exact) + lagged(whole))).astype(np.float32)


def _level(
    bands: tuple[NDArray[np.float64], ...], level: int, kernels: Kernels
) -> NDArray[np.float64]:
    """One level's bands at full size: (channels, TILE, TILE, 3)."""
    images = []
    for index, kernel in enumerate(kernels.bands()):
        coefficients = bands[level][:, :, index]
        margin = coefficients.shape[0] // 4
        inner = coefficients[margin:-margin, margin:-margin]
        image = band(coefficients / np.sqrt((inner**2).mean(axis=(0, 1))), kernel[::-1, ::-1])
        for finer in reversed(range(level)):
            size = (2 * TILE) >> finer
            image = double(image, (size, size), kernels)
        half = TILE // 2
        images.append(image[half : half + TILE, half : half + TILE])
    return np.stack(images, axis=-1).transpose(2, 0, 1, 3)
