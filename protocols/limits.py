"""Limits of what a study or a file of one may ask for before anything is made of it.

Each limit is raised by the environment variable ``METAMERLAB_LIMITS``, as those of pictures are:
``trials=1e6,unpacked=1e10``.
"""

from __future__ import annotations

import gzip
import io
import zlib
from pathlib import Path

from protocols.errors import StudyError
from protocols.outside import LIMITS_VARIABLE, check_within, limit


def check_trials(count: int) -> None:
    """Refuse a plan of more trials than the limit allows.

    Raises
    ------
    StudyError
        With the count, the limit and how to raise it.
    """
    most = limit("trials", StudyError)
    if count > most:
        raise StudyError(
            f"design: a participant must have at most {most:,} trials (got {count:,}); take fewer"
            f" repeats, or raise the limit with {LIMITS_VARIABLE}=trials={count}"
        )


def check_rows(path: Path, text: str) -> None:
    """Refuse a recording of more lines than the limit allows.

    Raises
    ------
    StudyError
        With the count, the limit and how to raise it.
    """
    check_within("rows", text.count("\n"), StudyError, path, "lines")


def check_cells(path: Path, text: str, separator: str = ",") -> None:
    """Refuse a table of more lines, or of more cells, than the limits allow.

    Raises
    ------
    StudyError
        With the count, the limit and how to raise it.
    """
    check_rows(path, text)
    count = text.count("\n") + text.count(separator)
    check_within("cells", count, StudyError, path, "cells")


def unpacked(data: bytes, path: Path) -> bytes:
    """Return what a gzip file holds, and nothing of one that unpacks to more than the limit.

    Raises
    ------
    StudyError
        If it is no whole gzip file, or holds more than the limit allows.
    """
    most = limit("text", StudyError)
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
            found = file.read(most + 1)
    except (EOFError, OSError, zlib.error):
        raise StudyError(f"{path}: must be a whole gzip file; copy it again") from None
    if len(found) > most:
        raise StudyError(
            f"{path}: must unpack to at most {most:,} bytes (it holds more); if it is"
            f" right, raise the limit with {LIMITS_VARIABLE}=text=NUMBER"
        )
    return found
