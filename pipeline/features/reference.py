"""A steerable pyramid of small kernels, and which of its coefficients a hole spoils.

Every level splits into four: an isotropic high band H, two oriented bands A_x and A_y
(one derivative-like profile along each axis), and a low band L, halved into the next
level. The same kernels put it together again, because
``H^2 + A_x^2 + A_y^2 + L^2 = 1`` (Simoncelli and Freeman 1995; Walton et al. 2021,
section 3.2; Kuffner dos Anjos et al. 2022, section 3.2, who keep only the finest high
band: docs/decisions/0015). Level k has ceil(size / 2^k) pixels; its pixel i covers pixels
2i and 2i + 1 of level k - 1, as in push-pull. Borders repeat.

Twin: bands.glsl (its constants are `band_constants` and `low_constants`), and lowpass.comp.glsl
in statistics/. Change both or neither.
"""

import json
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import Bools, Floats

BANDS = ("high", "along_x", "along_y")
MAX_LEVELS = 6


@dataclass(frozen=True, eq=False)
class Kernels:
    """Correlation kernels: `high` and `oriented` 3x3 with zero sum, `low` 4x4 with unit sum."""

    high: Floats
    oriented: Floats  # odd in x; its transpose is odd in y
    low: Floats

    def bands(self) -> tuple[Floats, ...]:
        """The kernels of `BANDS`, in that order."""
        return self.high, self.oriented, self.oriented.T


@dataclass(frozen=True, eq=False)
class Pyramid:
    """`bands[k]`: (H_k, W_k, 3 bands, channels); `residual`: what lies below the last level."""

    bands: tuple[Floats, ...]
    residual: Floats


@lru_cache(maxsize=1)
def fitted_kernels() -> Kernels:
    """The kernels that `benchmarks/fits/fit_kernels.py` wrote."""
    text = resources.files("pipeline.features").joinpath("kernels.json").read_text("utf-8")
    record = json.loads(text)
    return Kernels(*(np.array(record[name]) for name in ("high", "oriented", "low")))


def check_levels(levels: int) -> None:
    """Require 1 to 6 pyramid levels."""
    if not 1 <= levels <= MAX_LEVELS:
        raise InputError(f"levels must lie in 1..{MAX_LEVELS} (got {levels})")


def analyse(image: NDArray[np.floating], levels: int, kernels: Kernels | None = None) -> Pyramid:
    """Split an image of shape (H, W, channels) into bands.

    Raises
    ------
    InputError
        If `levels` is not in 1..6.
    """
    check_levels(levels)
    kernels = kernels or fitted_kernels()
    low = image.astype(np.float64)
    bands = []
    for _ in range(levels):
        bands.append(np.stack([band(low, kernel) for kernel in kernels.bands()], axis=2))
        low = halve(low, kernels)
    return Pyramid(tuple(bands), low)


def synthesise(pyramid: Pyramid, kernels: Kernels | None = None) -> Floats:
    """Put the bands together: every band passes its kernel again, mirrored.

    Mirroring turns analysis into its own inverse (Walton et al. 2021, section 3.4).
    """
    kernels = kernels or fitted_kernels()
    image = pyramid.residual
    for bands in reversed(pyramid.bands):
        image = double(image, bands.shape[:2], kernels)
        for index, kernel in enumerate(kernels.bands()):
            image = image + band(bands[:, :, index], kernel[::-1, ::-1])
    return image


def band(image: NDArray[np.floating], kernel: Floats) -> Floats:
    """Correlate (H, W, ...) with a 3x3 kernel of zero sum; exactly 0 on a constant."""
    padded = np.pad(image, ((1, 1), (1, 1)) + ((0, 0),) * (image.ndim - 2), mode="edge")
    height, width = image.shape[:2]
    total, tap = np.zeros(image.shape), np.empty(image.shape)  # no new array for every tap
    for row, column in np.argwhere(kernel):
        np.subtract(padded[row : row + height, column : column + width], image, out=tap)
        tap *= kernel[row, column]
        total += tap
    return total


def halve(image: NDArray[np.floating], kernels: Kernels | None = None) -> Floats:
    """Low-pass (H, W, ...) and keep every second pixel: (ceil(H / 2), ceil(W / 2), ...).

    The 4x4 taps lie evenly around the centre of the 2x2 pixels that one result covers.
    """
    low = (kernels or fitted_kernels()).low
    height, width = ((length + 1) // 2 for length in image.shape[:2])
    padded = np.pad(image, ((1, 2), (1, 2)) + ((0, 0),) * (image.ndim - 2), mode="edge")
    taps = [
        [padded[i : i + 2 * height : 2, j : j + 2 * width : 2] for j in range(4)] for i in range(4)
    ]
    near = taps[1][1]
    total, tap = np.zeros(near.shape), np.empty(near.shape)
    for i in range(4):
        for j in range(4):
            np.subtract(taps[i][j], near, out=tap)
            tap *= low[i, j]
            total += tap
    return np.asarray(near + total)


def double(
    coarse: NDArray[np.floating], size: tuple[int, int], kernels: Kernels | None = None
) -> Floats:
    """Bring a level up to twice its size: the transpose of `halve`, with gain 4."""
    low = (kernels or fitted_kernels()).low
    (near_y, far_y), (near_x, far_x) = (
        parents(length, coarse.shape[axis]) for axis, length in enumerate(size)
    )
    # A fine pixel meets its own parent at the kernel's inner taps, the next at the outer ones.
    near = coarse[near_y][:, near_x]
    weights = ((far_y, near_x, low[0, 1]), (near_y, far_x, low[1, 0]), (far_y, far_x, low[0, 0]))
    return np.asarray(near + sum(4 * w * (coarse[y][:, x] - near) for y, x, w in weights))


def parents(length: int, coarse_length: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices of the coarse pixel of each fine pixel of an axis, and of the other nearest one."""
    fine = np.arange(length)
    near = fine // 2
    return near, np.clip(near + 2 * (fine % 2) - 1, 0, coarse_length - 1)


def _children(length: int) -> NDArray[np.intp]:
    """Indices of the four taps of every coarse pixel along an axis, borders repeated."""
    first = 2 * np.arange((length + 1) // 2) - 1
    return np.asarray(np.clip(first[:, None] + np.arange(4), 0, length - 1))


def spoiled_levels(hole: Bools, levels: int, mixed: Bools | None = None) -> list[Bools]:
    """Tell, level by level, which coefficients can depend on a hole pixel.

    Parameters
    ----------
    mixed : ndarray of bool, shape (H_1, W_1), optional
        Pixels of the first low band that are of no use either; they spread as holes do.

    Returns
    -------
    list of ndarray of bool, shape (H_k, W_k)
        True where any band of level k reaches a hole, directly or through the low bands
        ("dilated" in Kuffner dos Anjos et al. 2022, Fig. 7; but the low bands spread
        the hole too, which one dilation by the kernel's radius forgets).
    """
    check_levels(levels)
    low = hole
    spoiled = []
    for _ in range(levels):
        spoiled.append(grow(low, 1))
        rows, columns = _children(low.shape[0]), _children(low.shape[1])
        low = np.logical_or.reduce(low[rows], axis=1)
        low = np.logical_or.reduce(low[:, columns], axis=2)
        if mixed is not None and len(spoiled) == 1:
            low = low | mixed
    return spoiled


def range_below(array: Floats) -> Floats:
    """Largest less smallest value among the 4x4 taps that `halve` averages."""
    rows, columns = _children(array.shape[0]), _children(array.shape[1])
    taps = array[rows][:, :, columns]
    return np.asarray(taps.max(axis=(1, 3)) - taps.min(axis=(1, 3)))


def grow(mask: Bools, radius: int) -> Bools:
    """Dilate a mask by a square of 2 * radius + 1 pixels."""
    padded = np.pad(mask, radius)
    height, width = mask.shape
    reach = range(2 * radius + 1)
    shifts = [padded[i : i + height, j : j + width] for i in reach for j in reach]
    return np.asarray(np.logical_or.reduce(shifts))


def band_constants() -> dict[str, float]:
    """The 3x3 kernels as the constants that bands.glsl declares."""
    kernels = fitted_kernels()
    return {
        "HIGH_EDGE": float(kernels.high[0, 1]),
        "HIGH_CORNER": float(kernels.high[0, 0]),
        "ORIENTED_EDGE": float(kernels.oriented[1, 2]),
        "ORIENTED_CORNER": float(kernels.oriented[0, 2]),
    }


def low_constants() -> dict[str, float]:
    """The low-pass's taps: of the inner two by two, beside them, and at the corners."""
    low = fitted_kernels().low
    return {
        "LOW_INNER": float(low[1, 1]),
        "LOW_MIXED": float(low[0, 1]),
        "LOW_OUTER": float(low[0, 0]),
    }
