"""Netpbm's and PFM's numbers as they are stored: no maximum, and no scale, is applied to them.

A PGM or PPM file states the largest number that it may hold, a PFM file a scale whose sign is the
order of the bytes. Its amount is ignored, as Middlebury's own reader does: writers put anything
there (pfmLib of its author, 1/255).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.picture_limits import check_values

_GAP = rb"(?:\s|#[^\n]*\n)+"
_HEADER = re.compile(
    rb"(P[2356fF])" + _GAP + rb"(\d{1,9})" + _GAP + rb"(\d{1,9})" + _GAP + rb"([-+.\deE]+)"
)
_HEADER_BYTES = 4096
_CHANNELS = {"P3": 3, "P6": 3, "PF": 3}


@dataclass(frozen=True)
class Netpbm:
    """Numbers of a file.

    Parameters
    ----------
    data : ndarray of uint8, uint16 or float32, shape (H, W, C)
        As stored, the upper row first.
    is_float : bool
        It is a PFM file.
    largest : int
        What a PGM or PPM file says of its numbers; 1 of a PFM file.
    """

    data: NDArray[Any]
    is_float: bool
    largest: int = 1

    def stretched(self) -> NDArray[Any]:
        """Integers in shares of the type's largest number, rounded down; floats as they are."""
        if self.is_float:
            return self.data
        most = np.iinfo(self.data.dtype).max
        return (self.data.astype(np.uint32) * most // self.largest).astype(self.data.dtype)


def read_netpbm(path: Path) -> Netpbm | None:
    """Return the numbers of a PGM, PPM or PFM file; None where it is none, or a bitmap.

    Raises
    ------
    InputError
        If it is cut short, or its numbers exceed the maximum that it states.
    """
    with path.open("rb") as file:
        match = _HEADER.match(file.read(_HEADER_BYTES))
        if match is None:
            return None
        kind, width, height = match[1].decode(), int(match[2]), int(match[3])
        shape = height, width, _CHANNELS.get(kind, 1)
        check_values(path, *shape)
        file.seek(match.end())
        body = file.read()
    is_float = kind in ("Pf", "PF")
    if not is_float and not match[4].isdigit():
        return None
    try:
        largest = float(match[4])
    except ValueError:
        return None
    floats, integers = "<f4" if largest < 0 else ">f4", ">u2" if largest > 255 else "u1"
    dtype = np.dtype(floats if is_float else integers)
    if kind in ("P2", "P3"):
        words = re.sub(rb"#[^\n]*", b"", body).split()
        if odd := [word for word in words if not word.isdigit()]:
            said = odd[0][:20].decode("latin-1")
            raise InputError(
                f"{path}: must hold whole numbers of 0 and more (one is {said!r}); write it again,"
                " as PFM if they are fractions or negative"
            )
        wanted, there = int(np.prod(shape)), len(words)
        found = np.array([min(int(word), 65535) for word in words], np.uint16)
    else:
        wanted = dtype.itemsize * int(np.prod(shape))
        # One white space ends the header; some programs write a line end of two.
        body = body[2 if body[:2] == b"\r\n" and len(body) == wanted + 2 else 1 :]
        there = len(body)
        found = np.frombuffer(body[: dtype.itemsize * (len(body) // dtype.itemsize)], dtype)
    if there > wanted:
        raise InputError(
            f"{path}: must end with its last number (it says {width} x {height} px, {wanted}"
            f" {'numbers' if kind in ('P2', 'P3') else 'bytes'}, and {there} follow its header:"
            " where they begin is not known); make it again, as one picture"
        )
    if found.size < np.prod(shape):
        raise InputError(
            f"{path}: must be a whole image (it says {width} x {height} px, and ends before); the"
            " file is damaged or was cut short: copy or make it again"
        )
    if not is_float and found.max() > largest:
        raise InputError(
            f"{path}: must hold numbers up to {largest:g}, as its header says (holds"
            f" {found.max()}); make it again"
        )
    data = found[: np.prod(shape)].reshape(shape).astype(dtype.newbyteorder("="))
    if is_float:
        return Netpbm(np.ascontiguousarray(data[::-1]), True)
    return Netpbm(data, False, int(largest))
