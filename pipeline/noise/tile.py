"""Tileable noise, split by the pyramid and brought back to full size, band by band.

Kuffner dos Anjos et al. 2022, 3.4: white noise passes the same filters as the image.
"Scaled to {-1, 1}" must mean unit variance per band for a deviation to mean anything; and
a coefficient map is not an image: each band passes its filter again and is brought up to
full size (Walton et al. 2021, 3.4). Both are done here, once per seed. What is left to do
per frame is to weigh the bands, for deviations vary slowly against the kernels.

Small kernels leave much of a band beyond its own octave, which finer bands measure: in a soft
texture more than all that they are asked for. So bands are softened on the way up: by the low-pass
of each level that they come through, and oriented ones by that of their own.

All bands come from the same white noise, so that where they overlap they add up to what their sum
measures, and can cancel out. Each is mixed with its neighbours first (mixing.py), or textures would
not get what they were weighed for.

The tile holds two texels per pixel along each axis: what lies halfway between two pixels of
noise is not their mean, which is softer, but the noise moved by half a pixel. A look-up
between texels then softens little, whatever the texture's spectrum.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.features.reference import BANDS, Kernels, band, double, fitted_kernels, halve
from pipeline.noise.mixing import LAGS, fitted_mixing

TILE = 256  # edge of the tile, pixels; a power of two
TEXELS_PER_PX = 2  # along each axis
TILE_TEXELS = TEXELS_PER_PX * TILE
# Rounded to this what lies between pixels hardly ever depends on how a library sums.
GRAIN = 2.0**-20


@dataclass(frozen=True, eq=False)
class NoiseBands:
    """One seed's noise, mixed: weigh it by deviations and sum.

    `tiles`: (levels, channels, TILE_TEXELS, TILE_TEXELS, 3 bands), a pixel's centre at every
    even texel; `lag_correlation`: (levels, 3 bands, 4 lags of `mixing.LAGS`), of
    neighbouring texels.
    """

    tiles: NDArray[np.floating]
    lag_correlation: NDArray[np.float32]


@lru_cache(maxsize=2)
def noise_bands(seed: int, levels: int, channels: int) -> NoiseBands:
    """Make the noise of one seed; the same on every platform, up to `GRAIN`; read-only."""
    dense = between(between(mixed_bands(seed, levels, channels), -2), -1)
    tiles = np.moveaxis(dense, 1, -1)
    lags = fitted_mixing(levels).lag_correlation
    noise = NoiseBands(np.ascontiguousarray(tiles, np.float32), lags)
    for array in (noise.tiles, noise.lag_correlation):
        array.flags.writeable = False
    return noise


def mixed_bands(seed: int, levels: int, channels: int, edge: int = TILE) -> NDArray[np.float64]:
    """Mix the unit bands of one seed: (levels, 3 bands, channels, edge, edge).

    Band b is the sum of all unit bands c times ``matrix[c, b]``: so weights mixed by the
    matrix, and unit bands weighed by them, are what is left to deviations (with their gains) and
    this tile.
    """
    found = np.empty((3 * levels, channels, edge, edge))
    for whole, one in zip(found, mixed(unit_bands(seed, levels, channels, edge)), strict=True):
        whole[:] = one
    return found.reshape(levels, 3, channels, edge, edge)


def mixed(bands: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    """Mix unit bands, (levels, channels, H, W, 3): each mixed band, (channels, H, W)."""
    levels, *size = bands.shape[:-1]
    rows = np.moveaxis(bands, -1, 1).reshape(3 * levels, *size)
    part = np.empty(rows.shape[1:])
    # Band by band, in order: a matrix product's order of sums depends on the library.
    for weights in fitted_mixing(levels).matrix.T:
        found = np.zeros(rows.shape[1:])
        for index in np.flatnonzero(weights):
            found += np.multiply(weights[index], rows[index], out=part)
        yield found


def between(tile: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Put a texel halfway between any two along `axis`: the periodic tile moved by half a texel.

    Every frequency keeps its amplitude, but the highest, which has no value there.
    """
    length = tile.shape[axis]
    turn = np.exp(1j * np.pi / length * np.arange(length // 2 + 1))
    spectrum = np.moveaxis(np.fft.rfft(tile, axis=axis), axis, -1) * turn
    moved = np.moveaxis(np.fft.irfft(spectrum, length), -1, axis)
    both = np.stack([tile, GRAIN * np.rint(moved / GRAIN)], axis=axis % tile.ndim + 1)
    shape = list(tile.shape)
    shape[axis] *= 2
    return both.reshape(shape)


def unit_bands(seed: int, levels: int, channels: int, edge: int = TILE) -> NDArray[np.float64]:
    """Make unmixed bands, (levels, channels, edge, edge, 3), each of unit variance."""
    return split(white_noise(seed, (edge, edge), channels), levels)


def white_noise(seed: int, size: tuple[int, int], channels: int) -> NDArray[np.float64]:
    """Make white noise of unit variance, the same on every platform: (H, W, channels)."""
    # Philox's raw bits are specified; a library's normal deviates might change.
    uniform = np.random.Philox(key=seed).random_raw(size[0] * size[1] * channels)
    white = ((uniform >> 11).astype(np.float64) * 2.0**-53 - 0.5) * np.sqrt(12.0)
    return np.asarray(white.reshape(*size, channels))


def split(white: NDArray[np.float64], levels: int) -> NDArray[np.float64]:
    """Split periodic noise (H, W, channels): (levels, channels, H, W, 3), of unit variance.

    H and W must be multiples of ``2 ** (levels - 1)``, so that every level is periodic.
    """
    kernels = fitted_kernels()
    low, (height, width, channels) = white, white.shape
    found = np.empty((levels, 3, channels, height, width))
    for level in range(levels):
        periodic = wrapped(low, 4)
        for index, kernel in enumerate(kernels.bands()):
            coefficients = band(periodic, kernel)[4:-4, 4:-4]
            tile = _full_size(coefficients, level, index, kernels)
            tile = tile / np.sqrt(np.maximum((tile**2).mean(axis=(0, 1)), 1e-12))
            found[level, index] = tile.transpose(2, 0, 1)
        low = halve(periodic, kernels)[2:-2, 2:-2]
    return np.moveaxis(found, 1, -1)


def _full_size(
    coefficients: NDArray[np.float64], level: int, index: int, kernels: Kernels
) -> NDArray[np.float64]:
    """Bring a level's coefficients of one band up, softened: (H, W, channels)."""
    # Filters reach a pixel (bands, doubling) and three (softening): so far the tile is repeated.
    image = band(wrapped(coefficients, 4), kernels.bands()[index][::-1, ::-1])
    if BANDS[index] != "high":
        image = softened(image, kernels)
    image = image[4:-4, 4:-4]
    for _ in range(level):
        coarse = wrapped(image, 2)
        finer = 2 * coarse.shape[0], 2 * coarse.shape[1]
        image = softened(double(coarse, finer, kernels), kernels)[4:-4, 4:-4]
    return image


def wrapped(tile: NDArray[np.float64], margin: int) -> NDArray[np.float64]:
    """Go on with a periodic (H, W, channels) by `margin` pixels on every side."""
    return np.pad(tile, ((margin, margin),) * 2 + ((0, 0),), mode="wrap")


def softened(image: NDArray[np.float64], kernels: Kernels) -> NDArray[np.float64]:
    """Pass the low-pass at full rate and, so that nothing moves, mirrored: (H, W, channels)."""
    height, width = image.shape[:2]
    corner, edge, inner = kernels.low[0, 0], kernels.low[0, 1], kernels.low[1, 1]
    for before in (1, 2):  # the kernel is its own mirror image: only its place changes
        padded = np.pad(image, ((before, 3 - before),) * 2 + ((0, 0),), mode="edge")
        outer = padded[:, :width] + padded[:, 3 : 3 + width]
        middle = padded[:, 1 : 1 + width] + padded[:, 2 : 2 + width]
        first, second = corner * outer + edge * middle, edge * outer + inner * middle
        image = first[:height] + first[3 : 3 + height]
        image += second[1 : 1 + height]
        image += second[2 : 2 + height]
    return image


def look_up(noise: NoiseBands, level: int, anchor_px: NDArray[np.float64]) -> NDArray[np.float64]:
    """Read one level's noise between texels without losing variance: (H, W, 3, channels).

    Bilinear weights w lower the variance to ``sum_ab w_a w_b R(a - b)``; dividing by its
    root keeps the texture from pulsing as it glides (3.4.1).
    """
    place = TEXELS_PER_PX * (anchor_px - 0.5)
    corner = np.floor(place)
    fraction = place - corner
    column, row = (corner[..., axis].astype(np.int64) for axis in (0, 1))
    x, y = fraction[..., 0], fraction[..., 1]
    tiles = noise.tiles[level].astype(np.float64)
    rows, columns = tiles.shape[1:3]
    taps = [
        ((0, 0), (1 - x) * (1 - y)),
        ((0, 1), x * (1 - y)),
        ((1, 0), (1 - x) * y),
        ((1, 1), x * y),
    ]
    mixed = sum(
        weight[..., None] * tiles[:, (row + down) % rows, (column + right) % columns]
        for (down, right), weight in taps
    )
    (_, a), (_, b), (_, c), (_, d) = taps
    pairs = {(0, 1): a * b + c * d, (1, 0): a * c + b * d, (1, 1): a * d, (1, -1): b * c}
    variance = (a * a + b * b + c * c + d * d)[..., None] + 2 * sum(
        pairs[lag][..., None] * noise.lag_correlation[level, :, index].astype(np.float64)
        for index, lag in enumerate(LAGS)
    )
    return np.moveaxis(np.asarray(mixed) / np.sqrt(variance), 0, -1)
