"""Limits of what a user's file may ask for before anything of it is unpacked.

A small file can name any size: without limits, a picture of 1.7 MiB took 6.8 GiB. Each limit is
raised by the environment variable ``METAMERLAB_LIMITS``, such as ``values=4e9,vertices=1e8``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import psutil

from pipeline.errors import InputError
from protocols.limits import LIMITS_VARIABLE, limit

MEMORY_FOR_A_BYTE, SECONDS_FOR_A_BYTE = 4000, 6e-5
"""Memory (bytes) and time (s) that each byte of a photograph allows beyond the limits, ..."""
MEMORY_FOR_A_BYTE_OF_A_MESH: Final = 400
PIXELS_OF_A_BYTE: Final = 60
"""... or a slide, which has 0.017 bytes a pixel and more as JPEG: flat colour as PNG has 0.003."""
_MIB: Final = 1 << 20
_FRAME_BYTES: Final = 12
NEEDS: Final = {
    "read": (150 * _MIB, 40, 0.2),
    "warp": (370 * _MIB, 135, 2.0),
    "foveate": (340 * _MIB, 100, 1.0),
    "foveate blur": (300 * _MIB, 32, 1.0),
    "foveate metamer": (340 * _MIB, 48, 1.0),
    "foveate by numpy": (190 * _MIB, 900, 5.0),
    "compress": (150 * _MIB, 540, 5.0),
    "decompress": (650 * _MIB, 30, 1.0),
    "denoise": (300 * _MIB, 1800, 9.0),
    "texture bake": (180 * _MIB, 12, 1.1),
    "score": (170 * _MIB, 60, 12.0),
}
"""Cost of a picture by command: bytes of memory in any case, bytes a pixel, and seconds for each
million pixels; measured on two cores without a graphics card."""
RATIO_FROM = 100_000_000
"""Numbers up to which a picture may be packed as tightly as flat colour is."""


def check_values(path: Path, *shape: int) -> None:
    """Refuse a picture or an array of more numbers than the limit allows.

    Raises
    ------
    InputError
        With the shape, the limit and how to raise it.
    """
    if min(shape, default=1) == 0:
        raise InputError(f"{path}: must hold at least one number (is {_by(shape)})")
    most, count = limit("values"), 1
    for edge in shape:
        count *= edge
    if count > most or min(shape, default=1) < 0:
        raise InputError(
            f"{path}: must hold at most {most:,} numbers (says that it holds"
            f" {_by(shape)}); if it is right, raise the limit with"
            f" {LIMITS_VARIABLE}=values={max(count, 0)}"
        )
    if count > RATIO_FROM and path.is_file():
        packed, ratio = max(path.stat().st_size, 1), limit("ratio")
        if count > packed * ratio:
            raise InputError(
                f"{path}: must hold at most {ratio:,} numbers in each byte (says that it holds"
                f" {count:,} in {packed:,} bytes); if it is right, raise the limit with"
                f" {LIMITS_VARIABLE}=ratio={-(-count // packed)}"
            )


def check_need(
    path: Path, command: str, width: int, height: int, packed: int | None = None, frames: int = 1
) -> None:
    """Refuse a picture for which a command of `NEEDS` takes more than so small a file may.

    Parameters
    ----------
    packed : int, optional
        Bytes of the file, where it is several.
    frames : int
        How many are held together.

    Raises
    ------
    InputError
        With the need, the limit and how to raise it; or what is free on this machine.
    """
    always, each, seconds = NEEDS[command]
    packed, pixels = path.stat().st_size if packed is None else packed, width * height
    size = f"{frames} x " * (frames > 1) + f"{width} x {height} px in {command!r}"
    need = always + each * pixels + _FRAME_BYTES * pixels * (frames - 1)
    need_s = seconds * pixels / 1e6
    counted = packed if pixels * frames <= PIXELS_OF_A_BYTE * packed else 0
    _check_small(path, "memory", need, MEMORY_FOR_A_BYTE * counted, size, packed)
    _check_small(path, "seconds", need_s, SECONDS_FOR_A_BYTE * counted, size, packed)


def check_memory(path: Path, need: int, what: str, packed: int, counted: int | None = None) -> None:
    """Refuse a mesh that takes more memory than the limit, and than so small a file may.

    Parameters
    ----------
    need : int
        Bytes that are about to be taken.
    what : str
        For what.
    packed : int
        Bytes of the file and of all that belong to it.
    counted : int, optional
        Bytes that allow more memory, where it is not all of them.

    Raises
    ------
    InputError
        With the need, the limit and how to raise it; or what is free on this machine.
    """
    counted = packed if counted is None else counted
    _check_small(path, "memory", need, MEMORY_FOR_A_BYTE_OF_A_MESH * counted, what, packed)


def _check_small(
    path: Path, name: str, need: float, allowed: float, what: str, packed: int
) -> None:
    most = limit(name) + allowed
    if need > most:
        memory = name == "memory"
        least, found = (
            (f"{one / 1e9:.3g} GB of memory" if memory else f"{one:.0f} s") for one in (most, need)
        )
        raise InputError(
            f"{path}: must take at most {least}, as a file of {packed:,} bytes may ({what} take"
            f" {found}); make it smaller, or, if it is right, raise the limit with"
            f" {LIMITS_VARIABLE}={name}={math.ceil(need)}"
        )
    free = psutil.virtual_memory().available + psutil.swap_memory().free
    free += psutil.Process().memory_info().rss  # the need counts what is held already
    if name == "memory" and need > free:
        raise InputError(
            f"{path}: must take at most {free / 1e9:.3g} GB of memory, which is what is free here"
            f" ({what} take {need / 1e9:.3g} GB); make it smaller, or end other programs"
        )


def _by(shape: Sequence[int]) -> str:
    return " x ".join(map(str, shape))


def check_vertices(path: Path, count: int) -> None:
    """Refuse a mesh with longer lists than the limit allows.

    Raises
    ------
    InputError
        With the count, the limit and how to raise it.
    """
    most = limit("vertices")
    if count > most:
        raise InputError(
            f"{path}: no list of a mesh must be longer than {most:,} (one has {count:,}); simplify"
            f" it, or raise the limit with {LIMITS_VARIABLE}=vertices={count}"
        )
