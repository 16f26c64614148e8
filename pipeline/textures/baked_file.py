"""The file of a baked texture: docs/formats/baked-texture.md.

Its size follows from the texture's, so that every byte's place is known before anything is read.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.textures.bake import BakedRows, BakedTexture, Layout, Plane, bake_rows, baked_of

ENDING = ".moments"
MAGIC = b"MMLT"
VERSION = 1
# version, goes round, width, height
_HEADER = struct.Struct("<4sBB2x II")
_CHECK = struct.Struct("<I")
_CHUNK = 1 << 24  # bytes that are checked at a time
_NOT_FINITE = 0x7C00  # the exponent of a half float that is no number


def head_bytes(layout: Layout) -> int:
    """Before the first plane: header, a checksum for each plane, and one of all these."""
    return _HEADER.size + _CHECK.size * (len(layout.planes()) + 1)


def write_baked(file: BinaryIO, layout: Layout, parts: Iterable[NDArray[np.uint8]]) -> None:
    """Bake a texture that comes in parts of its rows into an empty file, opened for writing."""
    planes = {(plane.level, plane.halvings): plane for plane in layout.planes()}
    checks = dict.fromkeys(planes, 0)
    start = head_bytes(layout)

    def put(level: int | None, halvings: int, at: int, rows: BakedRows) -> None:
        plane = planes[level, halvings]
        data = np.ascontiguousarray(rows, plane.dtype).tobytes()
        file.seek(start + plane.at + at * plane.row_bytes)
        file.write(data)
        checks[level, halvings] = zlib.crc32(data, checks[level, halvings])

    bake_rows(layout, parts, put)
    head = _HEADER.pack(MAGIC, VERSION, layout.wraps, layout.width, layout.height)
    head += b"".join(_CHECK.pack(check) for check in checks.values())
    file.seek(0)
    file.write(head + _CHECK.pack(zlib.crc32(head)))


def read_baked(path: Path) -> BakedTexture:
    """Map a file's planes into memory, each proven by its checksum; read-only.

    Raises
    ------
    FileNotFoundError
        If there is none.
    InputError
        Naming what does not hold; nothing large was allocated by then.
    """
    try:
        return _read(path)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _read(path: Path) -> BakedTexture:
    length = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_HEADER.size)
        if len(head) < _HEADER.size or not head.startswith(MAGIC):
            raise InputError(
                "must be a baked texture, which begins with MMLT; metamerlab texture bake makes one"
            )
        _, version, wraps, width, height = _HEADER.unpack(head)
        if version != VERSION:
            raise InputError(
                f"must be of version {VERSION} (is of version {version});"
                " a newer metamerlab reads it"
            )
        if wraps > 1:
            raise InputError(f"must say 0 or 1 for whether it goes round (says {wraps})")
        layout = Layout(width, height, bool(wraps))
        start = head_bytes(layout)
        if length != start + layout.nbytes:
            raise InputError(
                f"must have {start + layout.nbytes:,} bytes, as {width} x {height} px take (has"
                f" {length:,}): it was cut off or damaged; bake it again"
            )
        table = file.read(start - _HEADER.size)
    if zlib.crc32(head + table[: -_CHECK.size]) != _CHECK.unpack(table[-_CHECK.size :])[0]:
        raise InputError("the checksum of its head does not hold: it was damaged; bake it again")
    data = np.memmap(path, np.uint8, "r", offset=start)
    held = {}
    for plane, (check,) in zip(
        layout.planes(), _CHECK.iter_unpack(table[: -_CHECK.size]), strict=True
    ):
        part = data[plane.at : plane.at + plane.nbytes]
        _prove(plane, part, check)
        held[plane.level, plane.halvings] = part.view(plane.dtype).reshape(
            *plane.size, plane.channels
        )
    return baked_of(layout, held)


def _prove(plane: Plane, part: NDArray[np.uint8], check: int) -> None:
    name = "colour" if plane.level is None else f"moments of level {plane.level}"
    found = 0
    for at in range(0, len(part), _CHUNK):
        chunk = part[at : at + _CHUNK]
        found = zlib.crc32(chunk.data, found)
        if plane.level is not None and ((chunk.view("<u2") & _NOT_FINITE) == _NOT_FINITE).any():
            raise InputError(f"{name} at resolution {plane.halvings} must be finite; bake it again")
    if found != check:
        raise InputError(
            f"the checksum of the {name} at resolution {plane.halvings} does not hold: it was"
            " damaged; bake it again"
        )
