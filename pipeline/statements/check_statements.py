"""Checks of what a file says against the table: refusals, and notes of what is left out."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

from pipeline.errors import InputError
from pipeline.statements.row import rows_about
from pipeline.statements.rows import ROWS
from protocols.outside import visible_line

UPRIGHT: Final = "export it anew, upright"
NO_CURE: Final = "export it anew, as one flat picture for both eyes"
_VIDEOS: Final = {row.names: row for row in ROWS if row.of.startswith("video")}


def refusal(path: Path, name: str, found: str) -> InputError:
    """Return the error of a statement of any format that a row refuses."""
    (row,) = rows_about(ROWS, "any", name)
    return row.error(path, found)


class VideoStatement(NamedTuple):
    """A statement of a video: its row, its value in words, and what the row's cure takes.

    A value `cure` stands for the row's.
    """

    statement: str
    found: str
    values: Mapping[str, object] = {}


def other(of: str, what: str, name: str) -> Iterator[VideoStatement]:
    """Yield a part of a video's header that is in no row, such as a box of MP4."""
    if not rows_about(ROWS, of, name):
        yield VideoStatement("whatever else", f"{what} {name!r} in {of.partition(': ')[2]}")


def judged(path: Path, said: Iterable[VideoStatement]) -> list[str]:
    """Return notes of what a video says, or refuse it.

    Raises
    ------
    InputError
        If a row says so, with a command of FFmpeg that mends the file. A statement that no command
        mends comes first.
    """
    notes: dict[str, None] = {}
    refused: dict[str, tuple[str, Mapping[str, object]]] = {}
    for statement, found, values in said:
        row = _VIDEOS[statement]
        if row.verdict == "noted":
            notes[row.said(path, visible_line(found))] = None
        elif row.verdict == "refused":
            if cure := _words(statement, values):
                raise row.error(path, visible_line(found), cure)
            refused.setdefault(statement, (visible_line(found), values))
    if refused:
        musts = [
            f"{_VIDEOS[statement].words.partition('; ')[0]} ({found})"
            for statement, (found, _) in refused.items()
        ]
        raise InputError(
            f"{path}: {', and '.join(musts)}; this makes such a file: {_command(path, refused)}"
        )
    return list(notes)


def _words(statement: str, values: Mapping[str, object]) -> str:
    """A cure that is no command of FFmpeg."""
    cure = str(values.get("cure", _VIDEOS[statement].words.partition("; ")[2]))
    return "" if cure.startswith("-") else cure


def _command(path: Path, refused: Mapping[str, tuple[str, Mapping[str, object]]]) -> str:
    mended = path.with_name(f"{path.stem}-mended.mov")
    before: list[str] = []
    filters: list[str] = []
    after: list[str] = []
    # Fields are joined first: everything else is meant for whole frames.
    for statement in sorted(refused, key=lambda name: name != "interlacing"):
        values = {"aspect": "sar", **refused[statement][1]}
        options = str(values.get("cure", _VIDEOS[statement].words.partition("; ")[2]))
        chain, *rest = options.format_map(values).removeprefix("-vf ").split(" -", 1)
        filters.append(chain)
        before.append(str(values.get("reader", "")))
        after += [f"-{options}" for options in rest]
    chain = f'-vf "{",".join(filter(None, filters))}"' if any(filters) else ""
    words = ["ffmpeg", *before, "-i", shlex.quote(str(path)), "-map 0:v:0 -map_metadata -1", chain]
    words += [*after, "-c:v ffv1 -pix_fmt bgr0", shlex.quote(str(mended))]
    return " ".join(filter(None, words))
