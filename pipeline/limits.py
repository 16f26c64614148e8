"""How much a user's file may ask for before anything of it is unpacked.

A small file can name any size: without limits, a picture of 1.7 MiB took 6.8 GiB. Each limit is
raised by the environment variable ``METAMERLAB_LIMITS``, such as ``values=4e9,vertices=1e8``.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pipeline.errors import InputError
from protocols.outside import LIMITS_VARIABLE, limit

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
    most, count = limit("values", InputError), 1
    for edge in shape:
        count *= edge
    if count > most or min(shape, default=1) < 0:
        raise InputError(
            f"{path}: must hold at most {most:,} numbers (says that it holds"
            f" {_by(shape)}); if it is right, raise the limit with"
            f" {LIMITS_VARIABLE}=values={max(count, 0)}"
        )
    if count > RATIO_FROM and path.is_file():
        packed, ratio = max(path.stat().st_size, 1), limit("ratio", InputError)
        if count > packed * ratio:
            raise InputError(
                f"{path}: must hold at most {ratio:,} numbers in each byte (says that it holds"
                f" {count:,} in {packed:,} bytes); if it is right, raise the limit with"
                f" {LIMITS_VARIABLE}=ratio={-(-count // packed)}"
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
    most = limit("vertices", InputError)
    if count > most:
        raise InputError(
            f"{path}: no list of a mesh must be longer than {most:,} (one has {count:,}); simplify"
            f" it, or raise the limit with {LIMITS_VARIABLE}=vertices={count}"
        )
