"""Random bits from whole numbers: the same on every machine, and in any order."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Bits: TypeAlias = NDArray[np.uint32]


def pcg3d(x: Bits, y: Bits, z: Bits) -> tuple[Bits, Bits, Bits]:
    """Mix three arrays of whole numbers into three of random bits (Jarzynski and Olano 2020)."""
    x, y, z = (v * np.uint32(1664525) + np.uint32(1013904223) for v in (x, y, z))
    for scramble in (True, False):
        x = x + y * z
        y = y + z * x
        z = z + x * y
        if scramble:
            x, y, z = (v ^ (v >> np.uint32(16)) for v in (x, y, z))
    return x, y, z
