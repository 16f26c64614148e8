"""How much a user's file may ask for before anything of it is unpacked.

A small file can name any size: without limits, a picture of 1.7 MiB took 6.8 GiB. Each limit is
raised by the environment variable ``METAMERLAB_LIMITS``, such as ``values=4e9,vertices=1e8``.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import InputError

VARIABLE = "METAMERLAB_LIMITS"
VALUES = 1_000_000_000
"""Numbers in a picture or an array: pixels times channels."""
RATIO = 400
"""Numbers for each byte of the file, beyond `RATIO_FROM` of them: flat colour alone has more."""
RATIO_FROM = 100_000_000
VERTICES = 50_000_000
"""Entries of a mesh's lists: of its positions, of its indices, and so on."""


def limit(name: str, default: int) -> int:
    """Return a limit: the one that the environment gives, or the default.

    Raises
    ------
    InputError
        If the variable does not read NAME=NUMBER, with commas between.
    """
    for entry in filter(None, os.environ.get(VARIABLE, "").split(",")):
        key, _, value = entry.partition("=")
        if key.strip() == name:
            try:
                return int(float(value))
            except (ValueError, OverflowError):
                raise InputError(
                    f"{VARIABLE}: must read NAME=NUMBER, with commas between (got {entry!r})"
                ) from None
    return default


def check_values(path: Path, *shape: int) -> None:
    """Refuse a picture or an array of more numbers than the limit allows.

    Raises
    ------
    InputError
        With the shape, the limit and how to raise it.
    """
    if min(shape, default=1) == 0:
        raise InputError(f"{path}: must hold at least one number (is {_by(shape)})")
    most, count = limit("values", VALUES), 1
    for edge in shape:
        count *= edge
    if count > most or min(shape, default=1) < 0:
        raise InputError(
            f"{path}: must hold at most {most:,} numbers (says that it holds"
            f" {_by(shape)}); if it is right, raise the limit with"
            f" {VARIABLE}=values={max(count, 0)}"
        )
    if count > RATIO_FROM and path.is_file():
        packed = max(path.stat().st_size, 1)
        if count > packed * limit("ratio", RATIO):
            raise InputError(
                f"{path}: must hold at most {limit('ratio', RATIO):,} numbers in each byte (says"
                f" that it holds {count:,} in {packed:,} bytes); if it is right, raise the limit"
                f" with {VARIABLE}=ratio={-(-count // packed)}"
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
    most = limit("vertices", VERTICES)
    if count > most:
        raise InputError(
            f"{path}: no list of a mesh must be longer than {most:,} (one has {count:,}); simplify"
            f" it, or raise the limit with {VARIABLE}=vertices={count}"
        )


def visible_line(message: str) -> str:
    """Return the first line of what a library says, without what no terminal can show."""
    line = next(iter(message.strip().splitlines()), "no reason given")
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in line)[:200].rstrip(".")


@contextmanager
def reading(path: Path, what: str) -> Iterator[None]:
    """Turn whatever a library raises about a user's file into one message.

    Parameters
    ----------
    path : Path
        The file.
    what : str
        What it must be: ``a glTF 2.0 file``.

    Raises
    ------
    InputError
        In place of everything but what says enough by itself: our own errors, and files that
        are missing or may not be read.
    """
    try:
        yield
    except (InputError, FileNotFoundError, PermissionError, IsADirectoryError):
        raise
    except MemoryError:
        raise InputError(f"{path}: is too large for this machine's memory") from None
    except Exception as error:
        reason = visible_line(str(error) or type(error).__name__)
        raise InputError(
            f"{path}: must be {what} (its reader says: {reason}); export or copy it again"
        ) from error
