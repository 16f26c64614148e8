"""Pyramids of other bands, orientations and kernels, and metamers as Beyond Blur prints them.

For `script/bench foveate_bands`. A bank splits luma into bands on grids that are halved so often,
and puts them together again. The metamer is the printed one: a pyramid of one white picture, every
band of unit deviation, times the pooled deviation, plus the pooled mean; nothing is mixed and no
gain corrects the spectrum. So banks differ in nothing else, and the method that is shipped differs
from the bank `small kernels` in just that.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.colour import RGB_FROM_YCBCR, ycbcr_from_rgb
from pipeline.features.reference import Pyramid, analyse, double, halve, synthesise
from pipeline.foveation.chain import chain_length, chain_of, select
from pipeline.foveation.pooling import Pools
from pipeline.foveation.reference import finished

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Bands:
    """Bands of luma by a bank: `bands` are (halvings of the grid, coefficients (h, w))."""

    bands: list[tuple[int, Floats]]
    residual: Floats


@dataclass(frozen=True, eq=False)
class Bank:
    """A pyramid.

    Parameters
    ----------
    kernels : str
        In words, for a table.
    orientations : int
        Bands of a level that know a direction; 0: none does.
    split, join : callable
        From luma (H, W) to bands, and back to (H, W).
    """

    name: str
    kernels: str
    orientations: int
    levels: int
    split: Callable[[Floats], Bands]
    join: Callable[[Bands, tuple[int, int]], Floats]

    def kept_per_px(self, edge: int = 256) -> float:
        """Numbers kept of each pixel before they are pooled: two moments of each coefficient."""
        found = self.split(np.zeros((edge, edge)))
        return 2 * sum(band.size for _, band in found.bands) / edge**2


def small_kernels(levels: int, *, high_everywhere: bool = True) -> Bank:
    """The pyramid of this project: 3x3 bands, a 4x4 low-pass, a high band on every level."""

    def split(luma: Floats) -> Bands:
        pyramid = analyse(luma[..., None], levels)
        bands = [
            (level, coefficients[:, :, band, 0])
            for level, coefficients in enumerate(pyramid.bands)
            for band in range(3)
            if band or high_everywhere or level == 0
        ]
        return Bands(bands, pyramid.residual[..., 0])

    def join(found: Bands, _size: tuple[int, int]) -> Floats:
        waiting = iter(found.bands)
        stacks = []
        for level in range(levels):
            three = [
                next(waiting)[1] if band or high_everywhere or level == 0 else None
                for band in range(3)
            ]
            known = next(band for band in three if band is not None)
            stacks.append(
                np.stack([np.zeros_like(known) if b is None else b for b in three], axis=2)
            )
        pyramid = Pyramid(tuple(stack[..., None] for stack in stacks), found.residual[..., None])
        return synthesise(pyramid)[..., 0]

    where = "high band on every level" if high_everywhere else "high band on the finest level"
    return Bank(f"small kernels, {where}", "3x3, low-pass 4x4", 2, levels, split, join)


def laplacian(levels: int) -> Bank:
    """One band a level, what doubling the halved picture loses (Burt and Adelson 1983)."""

    def split(luma: Floats) -> Bands:
        bands, low = [], luma[..., None]
        for level in range(levels):
            coarse = halve(low)
            bands.append((level, (low - double(coarse, low.shape[:2]))[..., 0]))
            low = coarse
        return Bands(bands, low[..., 0])

    def join(found: Bands, _size: tuple[int, int]) -> Floats:
        image = found.residual[..., None]
        for _, band in reversed(found.bands):
            image = double(image, band.shape) + band[..., None]
        return image[..., 0]

    return Bank("Laplacian", "low-pass 4x4", 0, levels, split, join)


def haar(levels: int) -> Bank:
    """Sums and differences of 2x2 pixels: the smallest kernels there are."""

    def split(luma: Floats) -> Bands:
        bands, low = [], luma
        for level in range(levels):
            a, b, c, d = low[::2, ::2], low[::2, 1::2], low[1::2, ::2], low[1::2, 1::2]
            bands += [
                (level + 1, (a - b + c - d) / 4),
                (level + 1, (a + b - c - d) / 4),
                (level + 1, (a - b - c + d) / 4),
            ]
            low = (a + b + c + d) / 4
        return Bands(bands, low)

    def join(found: Bands, _size: tuple[int, int]) -> Floats:
        low = found.residual
        for level in reversed(range(levels)):
            x, y, xy = (band for _, band in found.bands[3 * level : 3 * level + 3])
            fine = np.empty((2 * low.shape[0], 2 * low.shape[1]))
            fine[::2, ::2], fine[::2, 1::2] = low + x + y + xy, low - x + y - xy
            fine[1::2, ::2], fine[1::2, 1::2] = low + x - y - xy, low - x - y + xy
            low = fine
        return low

    return Bank("Haar", "2x2", 2, levels, split, join)


def steerable(orientations: int, levels: int) -> Bank:
    """The steerable pyramid in the frequency domain (Simoncelli and Freeman 1995), even edges.

    Raised cosines an octave wide; `orientations` bands a level share every frequency's power.
    """

    def masks(edge: int) -> tuple[list[list[Floats]], Floats, Floats]:
        frequency = np.fft.fftfreq(edge) * 2 * np.pi
        fx, fy = np.meshgrid(frequency, frequency)
        radius, angle = np.hypot(fx, fy), np.arctan2(fy, fx)
        octaves = np.log2(np.maximum(radius, 1e-9) / np.pi)

        def low(cut: float) -> Floats:  # power 1 below 2^(cut - 1) of Nyquist, 0 above 2^cut
            return np.asarray(np.cos(np.pi / 2 * np.clip(octaves - cut + 1, 0, 1)))

        order = orientations - 1
        angular = [
            np.abs(np.cos(angle - np.pi * k / orientations)) ** order for k in range(orientations)
        ]
        power = np.sqrt(sum(a**2 for a in angular))
        rings = []
        for level in range(levels):
            outer, inner = low(-level), low(-level - 1)
            ring = outer * np.sqrt(np.clip(1 - inner**2, 0, 1))
            rings.append([ring * a / power for a in angular])
        return rings, np.sqrt(np.clip(1 - low(0) ** 2, 0, 1)), low(-levels)

    def split(luma: Floats) -> Bands:
        rings, high, low = masks(luma.shape[0])
        spectrum = np.fft.fft2(luma)

        def at(mask: Floats, halvings: int) -> Floats:
            return _cut(np.fft.ifft2(_inner(spectrum * mask, halvings)).real, halvings)

        bands = [(0, at(high, 0))]
        bands += [(level, at(m, level)) for level, ring in enumerate(rings) for m in ring]
        return Bands(bands, at(low, levels))

    def join(found: Bands, size: tuple[int, int]) -> Floats:
        rings, high, low = masks(size[0])
        total = np.zeros(size, np.complex128)
        flat = [high, *(mask for ring in rings for mask in ring)]
        for (halvings, band), mask in zip(found.bands, flat, strict=True):
            total += mask * _outer(np.fft.fft2(band), size[0], halvings)
        total += low * _outer(np.fft.fft2(found.residual), size[0], levels)
        return np.asarray(np.fft.ifft2(total).real)

    return Bank("steerable, Fourier", "as large as the picture", orientations, levels, split, join)


def _cut(image: Floats, halvings: int) -> Floats:
    return np.asarray(image / 4**halvings)


def _inner(spectrum: NDArray[np.complex128], halvings: int) -> NDArray[np.complex128]:
    """The frequencies that a grid halved so often has."""
    edge = len(spectrum)
    half = (edge >> halvings) // 2
    shifted = np.fft.fftshift(spectrum)
    middle = slice(edge // 2 - half, edge // 2 + half)
    return np.asarray(np.fft.ifftshift(shifted[middle, middle]))


def _outer(spectrum: NDArray[np.complex128], edge: int, halvings: int) -> NDArray[np.complex128]:
    """Undo `_inner`: zeros beyond."""
    whole = np.zeros((edge, edge), np.complex128)
    half = len(spectrum) // 2
    middle = slice(edge // 2 - half, edge // 2 + half)
    whole[middle, middle] = np.fft.fftshift(spectrum)
    return np.asarray(np.fft.ifftshift(whole) * 4**halvings)


def printed_metamer(
    picture: NDArray[np.float32], pools: Pools, bank: Bank, seed: int
) -> tuple[NDArray[np.float32], float, float]:
    """Make the metamer as printed, chroma pooled; also seconds of analysis and of synthesis.

    Parameters
    ----------
    picture : ndarray of shape (H, W, 3)
        Encoded R'G'B' in [0, 1]; square, edges that the bank's levels halve evenly.
    """
    size = (picture.shape[0], picture.shape[1])
    noise = bank.split(np.random.default_rng(seed).standard_normal(size))
    started_s = time.perf_counter()
    ycc = np.asarray(ycbcr_from_rgb(picture.astype(np.float64)), np.float64)
    found = bank.split(ycc[..., 0])
    chains = [_moments(band) for _, band in found.bands]
    colours = chain_of(ycc[..., 1:], chain_length(*size[::-1]), wraps=False)
    analysed_s = time.perf_counter()
    bands = []
    for (grid, _), chain, (_, white) in zip(found.bands, chains, noise.bands, strict=True):
        mean, square = _chosen(chain, pools, grid)
        deviation = np.sqrt(np.maximum(square - mean**2, 0))
        bands.append((grid, mean + deviation * white / white.std()))
    made = np.empty_like(ycc)
    made[..., 0] = bank.join(Bands(bands, found.residual), size)
    made[..., 1:] = select(colours, pools.lod, wraps=False)
    shown = finished(picture, made @ RGB_FROM_YCBCR.T, pools)
    return shown, analysed_s - started_s, time.perf_counter() - analysed_s


def _moments(band: Floats) -> list[Floats]:
    height, width = band.shape
    return chain_of(np.stack([band, band**2], axis=2), chain_length(width, height), wraps=False)


def _chosen(chain: Sequence[Floats], pools: Pools, grid: int) -> tuple[Floats, Floats]:
    """Mean and mean square of each coefficient's pool."""
    chosen = select(chain, lambda halvings: pools.lod(grid + halvings, grid), wraps=False)
    return chosen[..., 0], chosen[..., 1]
