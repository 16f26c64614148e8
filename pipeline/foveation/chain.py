"""Chains of halvings, and the level of detail of each pixel chosen from them.

Halving is the pyramid's low-pass; doubling is by 3/4 and 1/4. A panorama goes on at its other
side, everything else repeats its border.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pipeline.features.reference import band as plain_band
from pipeline.features.reference import halve as plain_halve
from pipeline.frame import Floats

LEAST_EDGE = 8  # no halving of pictures whose longer edge is at most this


def chain_length(width_px: int, height_px: int) -> int:
    """Number of halvings of a picture, at least 2, until its longer edge is at most 8 pixels."""
    count, edge = 2, -(-max(width_px, height_px) // 4)
    while edge > LEAST_EDGE:
        count, edge = count + 1, -(-edge // 2)
    return count


def halve_around(image: Floats, *, wraps: bool) -> Floats:
    """Low-pass (H, W, channels) and keep every second pixel."""
    if not wraps:
        return plain_halve(image)
    width = image.shape[1]
    sides = (0, 0), (2, 2 + width % 2), (0, 0)
    return plain_halve(np.pad(image, sides, mode="wrap"))[:, 1 : 1 + (width + 1) // 2]


def band_around(image: Floats, kernel: Floats, *, wraps: bool) -> Floats:
    """Correlate (H, W, channels) with a 3x3 kernel of zero sum."""
    if not wraps:
        return plain_band(image, kernel)
    return plain_band(np.pad(image, ((0, 0), (1, 1), (0, 0)), mode="wrap"), kernel)[:, 1:-1]


def halve_box(image: Floats) -> Floats:
    """Average 2x2 pixels of (H, W, channels); an odd border repeats its last pixel."""
    height, width = image.shape[:2]
    even = np.pad(image, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    return np.asarray((even[::2, ::2] + even[::2, 1::2] + even[1::2, ::2] + even[1::2, 1::2]) / 4)


def enlarge(coarse: Floats, size: tuple[int, int], halvings: int, *, wraps: bool) -> Floats:
    """Interpolate (h, w, channels) linearly at the pixels of a resolution `halvings` finer.

    One halving finer this is doubling, by 3/4 and 1/4.

    Parameters
    ----------
    size : (height, width)
        Of the result.
    """
    for axis, (length, repeats) in enumerate(zip(size, (False, wraps), strict=True)):
        place = (np.arange(length) + 0.5) / (1 << halvings) - 0.5
        first = np.floor(place).astype(np.intp)
        count = coarse.shape[axis]
        before, after = (
            index % count if repeats else np.clip(index, 0, count - 1)
            for index in (first, first + 1)
        )
        share = (place - first).reshape((-1, *(1,) * (coarse.ndim - 1 - axis)))
        coarse = (1 - share) * coarse.take(before, axis) + share * coarse.take(after, axis)
    return coarse


def chain_of(image: Floats, count: int, *, wraps: bool) -> list[Floats]:
    """`image` (H, W, channels) and `count` halvings of it."""
    chain = [image]
    for _ in range(count):
        chain.append(halve_around(chain[-1], wraps=wraps))
    return chain


def select(
    chain: Sequence[Floats],
    lod_at: Callable[[int], Floats],
    *,
    first: int = 0,
    wraps: bool,
) -> Floats:
    """Choose each pixel's level of detail from a chain, as a push.

    From coarse to fine: ``r_n = (1 - a_n) m_n + a_n double(r_(n + 1))``, with
    ``a_n = clamp(lod - n, 0, 1)``. On a map of equal levels this is linear interpolation between
    the two nearest.

    Parameters
    ----------
    chain : sequence of ndarray
        m_first, m_(first + 1), ...: halvings of one picture.
    lod_at : callable
        Gives the level of detail (h, w) at the texels of ``chain[i]``, by i + `first`.
    first : int
        The level of detail that ``chain[0]`` stands for.
    """
    chosen = chain[-1]
    for index in reversed(range(len(chain) - 1)):
        fine = chain[index]
        share = np.clip(lod_at(first + index) - (first + index), 0, 1)[..., None]
        chosen = (1 - share) * fine + share * enlarge(chosen, fine.shape[:2], 1, wraps=wraps)
    return chosen
