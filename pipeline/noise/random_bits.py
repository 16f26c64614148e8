"""Random bits from whole numbers: the same on every machine, and in any order."""

from __future__ import annotations

from enum import IntEnum
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

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
