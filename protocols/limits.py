"""The one table of limits of what files and devices of users may ask for, and its checks.

Those of `LIMITS` are raised by the environment variable ``METAMERLAB_LIMITS``, such as
``values=4e9,trials=1e6``. docs/formats/limits.md shows the tables.
"""

from __future__ import annotations

import gzip
import io
import os
import zlib
from difflib import get_close_matches
from pathlib import Path
from typing import Final, NamedTuple

from protocols.errors import StudyError, must_be_one_of

LIMITS_VARIABLE = "METAMERLAB_LIMITS"
"""The environment variable that raises limits: ``values=4e9,trials=1e6``."""


class Limit(NamedTuple):
    """The largest number that is accepted, and of what."""

    most: int
    of: str


LIMITS: Final = {
    "values": Limit(
        1_000_000_000,
        "numbers in a picture, an array or a video frame: pixels times channels",
    ),
    "ratio": Limit(400, "numbers for each byte of a picture's file, beyond 100,000,000 numbers"),
    "memory": Limit(
        1 << 30,
        "bytes of memory that a command takes for a picture or a mesh; bytes of an ONNX network"
        " with its weights",
    ),
    "seconds": Limit(20, "seconds that a command takes for a picture"),
    "unpacked": Limit(2_000_000_000, "bytes in an archive of JATOS"),
    "text": Limit(250_000_000, "bytes of a recording, a manifest or a sheet of a spreadsheet"),
    "table": Limit(100_000_000, "bytes of a table or a journal"),
    "toml": Limit(2_000_000, "bytes of a study or display file"),
    "rows": Limit(5_000_000, "lines of a table or a recording"),
    "cells": Limit(3_000_000, "cells of a table, values in JSON"),
    "events": Limit(300_000, "lines of a journal"),
    "files": Limit(100_000, "files of a zip file, stimuli of a table"),
    "vertices": Limit(50_000_000, "entries of a list of a mesh: positions, indices, ..."),
    "nodes": Limit(
        10_000,
        "meshes, nodes, materials, textures or groups of a mesh, files that it names, each",
    ),
    "triangles": Limit(20_000_000, "triangles of a mesh"),
    "trials": Limit(100_000, "trials of one participant"),
}
"""Limits that can be raised, by name."""
FIXED: Final = {
    "edge": Limit(65_536, "pixels of an edge of a picture in a study"),
    "frame_edge": Limit(
        16_384,
        "pixels of an edge of a frame to fill, a compressed picture or a texture",
    ),
    "compressed": Limit(2**25, "pixels of a compressed picture"),
    "compressed_frames": Limit(100_000, "frames of a compressed clip"),
    "keys": Limit(32, "parts of a key in a study or display file"),
    "columns": Limit(16_384, "columns of a table"),
    "sheet_rows": Limit(1_048_576, "rows of a spreadsheet"),
    "cell": Limit(32_767, "characters in a cell of a spreadsheet"),
    "design": Limit(
        1000, "pairs, scenes, repeats or participants of a design without a study file"
    ),
    "conditions": Limit(200, "conditions of a table that are compared with each other"),
    "effects": Limit(50_000, "participants and scenes, with their conditions, of a mixed model"),
    "effect_pairs": Limit(20_000_000, "pairs of them that its equations tie"),
    "channels": Limit(256, "channels of a stream of gaze"),
    "stream_hz": Limit(20_000, "samples a second of a stream of gaze"),
    "jatos": Limit(2 << 30, "bytes of a package for JATOS"),
}
"""Limits that nothing raises, by name."""


def limit(name: str) -> int:
    """Return a limit of `LIMITS`: the one that the environment gives, or the default.

    Raises
    ------
    StudyError
        If the variable does not read NAME=NUMBER, with commas between, or names no limit.
    """
    found = {key: one.most for key, one in LIMITS.items()}
    for entry in filter(str.strip, os.environ.get(LIMITS_VARIABLE, "").split(",")):
        key, _, value = (part.strip() for part in entry.partition("="))
        try:
            number = int(float(value))
            if number < 0:
                raise ValueError
        except (ValueError, OverflowError):
            raise StudyError(
                f"{LIMITS_VARIABLE}: must read NAME=NUMBER, with commas between (got {entry!r})"
            ) from None
        if key not in LIMITS:
            raise StudyError(must_be_one_of(f"{LIMITS_VARIABLE}: NAME", key, LIMITS))
        found[key] = number
    return found[name]


def network_limits(pixels: int, packed: int) -> dict[str, float]:
    """Return bytes of memory and seconds that an ONNX network may take, by the name of the limit.

    For each pixel it may hold 32 maps of 64 channels at once (8 KiB) and do 10 million operations
    at 20 billion a second, several times what inpainting networks do; its weights may be held four
    times, and each 20 MB of them take a second.
    """
    memory, seconds = limit("memory") / 2, limit("seconds") / 2
    return {
        "memory": memory + 8192 * pixels + 4 * packed,
        "seconds": seconds + 5e-4 * pixels + packed / 2e7,
    }


def check_limits_variable() -> None:
    """Refuse the variable of limits if it is misspelt or cannot be read.

    Raises
    ------
    StudyError
        Naming the variable and what was found.
    """
    for name in os.environ:
        if name != LIMITS_VARIABLE and get_close_matches(name.upper(), [LIMITS_VARIABLE], 1, 0.85):
            raise StudyError(f"{name}: must be spelt {LIMITS_VARIABLE}; rename this variable")
    limit("values")


def check_within(
    name: str, count: int, error: type[Exception], path: Path, what: str, verb: str = "have"
) -> None:
    """Refuse a file with more than a limit allows.

    Parameters
    ----------
    name : str
        Of the limit.
    what : str
        What is counted: ``lines``.

    Raises
    ------
    error
        With the count, the limit and how to raise it.
    """
    most = limit(name)
    if count > most:
        raise error(
            f"{path}: must {verb} at most {most:,} {what} (has {count:,}); if it is right, raise"
            f" the limit with {LIMITS_VARIABLE}={name}={count}"
        )


def check_trials(count: int) -> None:
    """Refuse a plan of more trials than the limit allows.

    Raises
    ------
    StudyError
        With the count, the limit and how to raise it.
    """
    most = limit("trials")
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


def gunzipped(data: bytes, path: Path) -> bytes:
    """Return the content of a gzip file, and nothing of one that unpacks to more than the limit.

    Raises
    ------
    StudyError
        If it is no whole gzip file, or holds more than the limit allows.
    """
    most = limit("text")
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
