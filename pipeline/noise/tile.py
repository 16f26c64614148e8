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
measures, and can cancel out. Each is mixed with its neighbours first (gains.py), or textures would
not get what they were weighed for.

All of this is done in whole numbers, from random bits that are the same on every machine and in any
order: white noise of 13 bits, taps in steps of 2^-14, and a rounded
division behind each filter. Their sums do not depend on their order, so a graphics card finds the
very same noise (gpu.py, docs/decisions/0219).

The tile holds two texels per pixel along each axis: what lies halfway between two pixels of
noise is not their mean, which is softer, but the noise moved by half a pixel. A look-up
between texels then softens little, whatever the texture's spectrum.

Twins: the shaders in this folder. Change both or neither.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.features.reference import fitted_kernels
from pipeline.frame import Floats
from pipeline.noise.gains import LAGS, fitted_mixing

Bits: TypeAlias = NDArray[np.uint32]


class Stream(IntEnum):
    """Uses of a seed: each has bits of its own."""

    BANDS = 0
    FIELD = 1
    OCTAVES = 2
    START = 3
    LATTICE = 4


def key_of(seed: int, stream: Stream) -> tuple[int, int, int]:
    """Key to mix places with: three whole numbers of 32 bits."""
    # Philox's raw bits are specified; a library's other generators might change.
    low, high = np.random.Philox(key=[seed, stream]).random_raw(2)
    return int(low) & 0xFFFFFFFF, int(low) >> 32, int(high) & 0xFFFFFFFF


def pcg3d(x: Bits, y: Bits, z: Bits) -> tuple[Bits, Bits, Bits]:
    """Mix three arrays of whole numbers into three of random bits (Jarzynski and Olano 2020).

    Twin: shaderlib/hashing.glsl. Change both or neither.
    """
    x, y, z = (v * np.uint32(1664525) + np.uint32(1013904223) for v in (x, y, z))
    for scramble in (True, False):
        x = x + y * z
        y = y + z * x
        z = z + x * y
        if scramble:
            x, y, z = (v ^ (v >> np.uint32(16)) for v in (x, y, z))
    return x, y, z


Steps: TypeAlias = NDArray[np.int32]
"""Noise in whole numbers."""

TILE = 256  # edge of the tile, pixels; a power of two
TEXELS_PER_PX = 2  # along each axis
TILE_TEXELS = TEXELS_PER_PX * TILE
# Rounded to this what lies between pixels hardly ever depends on how a library sums.
GRAIN = 2.0**-20
WHITE_BITS = 13  # of white noise: odd numbers from 1 - 2^13 to 2^13 - 1
WHITE_DEVIATION = float(np.sqrt((4.0**WHITE_BITS - 1) / 3))
TAP_BITS = 14  # of a filter's taps behind the point
# Filters have such gains that bands of all levels have 500 to 4000 steps of deviation: eight
# deviations fit 16 bits, and rounding is a thousandth.
HALVING_GAIN, SOFT_GAIN, ORIENTED_GAIN = 2, 4, 2
MIXED_STEP = 2.0**-24  # of mixed noise, deviations


@dataclass(frozen=True, eq=False)
class NoiseBands:
    """One seed's noise, mixed: weigh it by deviations and sum.

    `tiles`: (levels, channels, TILE_TEXELS, TILE_TEXELS, 3 bands), a pixel's centre at every
    even texel; `lag_correlation`: (levels, 3 bands, 4 lags of `gains.LAGS`), of
    neighbouring texels.
    """

    tiles: NDArray[np.floating]
    lag_correlation: NDArray[np.float32]


@lru_cache(maxsize=2)
def noise_bands(seed: int, levels: int, channels: int) -> NoiseBands:
    """Make the noise of one seed; the same on every platform, up to `GRAIN`; read-only."""
    dense = midway(midway(mixed_bands(seed, levels, channels), -2), -1)
    tiles = np.moveaxis(dense, 1, -1)
    lags = fitted_mixing(levels).lag_correlation
    noise = NoiseBands(np.ascontiguousarray(tiles, np.float32), lags)
    for array in (noise.tiles, noise.lag_correlation):
        array.flags.writeable = False
    return noise


def mixed_bands(seed: int, levels: int, channels: int, edge: int = TILE) -> Floats:
    """Mix the unit bands of one seed: (levels, 3 bands, channels, edge, edge).

    Band b is the sum of all unit bands c times ``matrix[c, b]``: so weights mixed by the
    matrix, and unit bands weighed by them, are what is left to deviations (with their gains) and
    this tile.
    """
    found = np.empty((3 * levels, channels, edge, edge))
    bands = split(white_steps(seed, (edge, edge), channels), levels)
    for whole, one in zip(found, mixed(bands), strict=True):
        whole[:] = one
    return found.reshape(levels, 3, channels, edge, edge)


def mixed(bands: Steps) -> Iterator[Floats]:
    """Mix bands as `split` gives them: each mixed band, (channels, H, W), of unit variance."""
    levels, _, channels, height, width = bands.shape
    rows = bands.reshape(3 * levels, channels, height, width)
    weights = np.stack(
        [
            mixing_weights([square_sum(row[channel]) for row in rows], height * width)
            for channel in range(channels)
        ],
        axis=-1,
    )
    part = np.empty(rows.shape[1:], np.int32)
    for own in weights:
        found = np.zeros(rows.shape[1:], np.int32)
        for row, weight in zip(rows, own, strict=True):
            if weight.any():
                found += np.multiply(row, weight[:, None, None], out=part)
        yield found * MIXED_STEP


def unit(band: Steps) -> Floats:
    """A band, (H, W), as a part of its own deviation."""
    return np.asarray(band / np.sqrt(max(square_sum(band) / band.size, 1.0)))


def mixing_weights(squares: list[int], count: int) -> Steps:
    """Weights of bands in mixed bands, in `MIXED_STEP` for a step of a band: (mixed, bands).

    Parameters
    ----------
    squares : list of int, shape (B,)
        The sum of a band's squares over `count` pixels; B = 3 * levels.
    """
    # A panorama of two pixels has bands in which nothing is.
    deviations = np.sqrt(np.maximum(np.array(squares, np.float64) / count, 1.0))
    matrix = fitted_mixing(len(squares) // 3).matrix
    return np.rint(matrix.T / deviations / MIXED_STEP).astype(np.int32)


def square_sum(band: Steps) -> int:
    """Sum of squares, (H, W); exact."""
    steps = band.ravel().astype(np.float64)  # sums of whole numbers below 2^53
    return int(steps @ steps)


def midway(tile: Floats, axis: int) -> Floats:
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


def white_noise(
    seed: int, size: tuple[int, int], channels: int, stream: Stream = Stream.BANDS
) -> Floats:
    """Make white noise of unit variance, the same on every platform: (H, W, channels)."""
    return np.moveaxis(white_steps(seed, size, channels, stream), 0, -1) / WHITE_DEVIATION


def white_steps(
    seed: int, size: tuple[int, int], channels: int, stream: Stream = Stream.BANDS
) -> Steps:
    """Make white noise of the deviation `WHITE_DEVIATION`: (channels, H, W), channels 1 to 3."""
    keys = np.array(key_of(seed, stream), np.uint32)
    rows, columns = np.indices(size, np.uint32, sparse=True)
    bits = pcg3d(columns ^ keys[0], rows ^ keys[1], keys[2:3])[:channels]
    numbers = np.stack(bits) >> np.uint32(32 - WHITE_BITS)
    return 2 * numbers.astype(np.int32) + np.int32(1 - 2**WHITE_BITS)


def split(white: Steps, levels: int) -> Steps:
    """Split periodic noise (channels, H, W): (levels, 3 bands, channels, H, W).

    H and W must be multiples of ``2 ** (levels - 1)``, so that every level is periodic.
    """
    taps = noise_taps()
    lows = [white]
    for _ in range(levels - 1):
        lows.append(_filtered(lows[-1], taps.halving, step=2))
    raised = np.empty((0, *lows[-1].shape), np.int32)  # from the coarsest level on
    for low in reversed(lows):
        coarse, raised = raised, np.empty((len(raised) + 3, *low.shape), np.int32)
        _raise(coarse, raised[:-3], taps.raising)
        soft = _filtered(low, taps.soft)
        raised[-3] = _filtered(low, taps.high)
        raised[-2] = _filtered(soft, taps.oriented)
        raised[-1] = _filtered(soft, taps.oriented.T)
    return raised.reshape(levels, 3, *white.shape)[::-1]


@dataclass(frozen=True, eq=False)
class NoiseTaps:
    """Filters in whole numbers, `TAP_BITS` behind the point.

    `halving` (4, 4): the low-pass. `soft` (7, 7): the low-pass there and, so that nothing moves,
    back. `high`, `oriented` (5, 5): a band's filter there and back, and so of zero sum; along y the
    transpose. `raising` (5, 5): what an even pixel of even row takes of the coarser ones around its
    own, doubled and softened; of odd pixels or rows the mirror image.
    """

    halving: Steps
    soft: Steps
    high: Steps
    oriented: Steps
    raising: Steps


def softening() -> Floats:
    """The low-pass there and back: (7, 7)."""
    low = fitted_kernels().low
    return _spread(low, low)


def noise_taps() -> NoiseTaps:
    """Make the filters from the pyramid's."""
    kernels, soft = fitted_kernels(), softening()
    return NoiseTaps(
        _whole(HALVING_GAIN * kernels.low),
        _whole(SOFT_GAIN * soft),
        _balanced(_whole(_spread(kernels.high, kernels.high[::-1, ::-1]))),
        _balanced(_whole(ORIENTED_GAIN * _spread(kernels.oriented, kernels.oriented[::-1, ::-1]))),
        _whole(_spread(4 * kernels.low, soft)[8::-2, 8::-2]),
    )


def _spread(first: Floats, second: Floats) -> Floats:
    """Convolve two kernels."""
    height, width = second.shape
    found = np.zeros(np.add(first.shape, second.shape) - 1)
    for (row, column), tap in np.ndenumerate(first):
        found[row : row + height, column : column + width] += tap * second
    return found


def _whole(kernel: Floats) -> Steps:
    return np.rint(2.0**TAP_BITS * kernel).astype(np.int32)


def _balanced(taps: Steps) -> Steps:
    """Take from the middle tap what rounding left of a zero sum."""
    taps[len(taps) // 2, len(taps) // 2] -= taps.sum()
    return taps


def _filtered(image: Steps, taps: Steps, step: int = 1) -> Steps:
    """Correlate a periodic (..., H, W), keep every `step`-th pixel, and divide, rounded."""
    height, width = image.shape[-2:]
    before = (len(taps) - 1) // 2
    margins = ((0, 0),) * (image.ndim - 2) + ((before, len(taps) - 1 - before),) * 2
    padded = np.pad(image, margins, mode="wrap")
    total = np.full((*image.shape[:-2], height // step, width // step), 1 << TAP_BITS - 1, np.int32)
    part = np.empty_like(total)
    for row, column in np.argwhere(taps):
        near = padded[..., row : row + height : step, column : column + width : step]
        total += np.multiply(near, taps[row, column], out=part)
    total >>= TAP_BITS
    return total


def _raise(coarse: Steps, fine: Steps, taps: Steps) -> None:
    """Bring a periodic (..., H, W) up into `fine`, twice as large: doubled and softened."""
    if not coarse.size:
        return
    for row in (0, 1):
        for column in (0, 1):
            own = taps[:: 1 - 2 * row, :: 1 - 2 * column]
            fine[..., row::2, column::2] = _filtered(coarse, own)


def look_up(noise: NoiseBands, level: int, anchor_px: Floats) -> Floats:
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
