"""Checks of what a file says against the table: refusals, and notes of what is left out."""

from __future__ import annotations

import shlex
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from pipeline.errors import InputError, note
from pipeline.image_header import WALKERS, read_statements
from pipeline.statements.row import Use, rows_of
from pipeline.statements.rows import ROWS
from protocols.outside import visible_line

UPRIGHT: Final = "export it anew, upright"
NO_CURE: Final = "export it anew, as one flat picture for both eyes"
_LISTED = 6  # names that a message lists
_VIDEOS: Final = {row.names: row for row in ROWS if row.of.startswith("video")}


def refusal(path: Path, name: str, found: str) -> InputError:
    """Return the error of a statement of any format that a row refuses."""
    (row,) = rows_of(ROWS, "any", name)
    return row.error(path, found)


def check_statements(
    path: Path,
    kind: str,
    general: Mapping[str, Any],
    use: Sequence[Use],
    *,
    handled: Sequence[str] = (),
) -> None:
    """Refuse or note what a picture's header says and no reader honours.

    Parameters
    ----------
    path : Path
    kind : str
        OpenImageIO's name of the format.
    general : mapping
        What OpenImageIO itself reads: the rows of ``"any"``.
    use : sequence of Use
        What the file is read for.
    handled : sequence of str
        Statements that the caller deals with.

    Raises
    ------
    InputError
        If a statement is refused.
    """
    noted: dict[str, None] = {}
    unknown: dict[str, None] = {}
    for of, statements in (("any", general), *((kind, s) for s in read_statements(path, kind))):
        for name, value in statements.items():
            rows = [] if name in handled else rows_of(ROWS, of, name)
            if not rows and name not in handled:
                unknown[name] = None
            for row in rows:
                if not row.words or row.verdict == "honoured" or not set(row.use) & set(use):
                    continue
                try:
                    found = f"its header has {name}" if row.judge is None else row.judge(
                        value, statements
                    )  # fmt: skip
                except (struct.error, ValueError, IndexError, TypeError, ZeroDivisionError):
                    noted[f"{name} is not understood, and left out: {row.words}"] = None
                    continue
                if found is not None:
                    noted[row.said(path, found)] = None
    if kind not in WALKERS:
        noted[f"what files of {kind} say beside their pixels is not looked at"] = None
    if unknown:
        listed = ", ".join([*unknown][:_LISTED])
        more = f" and {len(unknown) - _LISTED} more" if len(unknown) > _LISTED else ""
        noted[f"not known, and left out: {listed}{more}"] = None
    for text in noted:
        note(path, text)


class Said(NamedTuple):
    """A statement of a video: its row, its value in words, and what the row's cure takes.

    A value `cure` stands for the row's.
    """

    statement: str
    found: str
    values: Mapping[str, object] = {}


def other(of: str, what: str, name: str) -> Iterator[Said]:
    """Yield a part of a video's header that is in no row, such as a box of MP4."""
    if not rows_of(ROWS, of, name):
        yield Said("whatever else", f"{what} {name!r} in {of.partition(': ')[2]}")


def judged(path: Path, said: Iterable[Said]) -> list[str]:
    """Return notes of what a video says, or refuse it.

    Raises
    ------
    InputError
        At the first statement whose row says so, with a command of FFmpeg that mends the file.
    """
    notes: dict[str, None] = {}
    for statement, found, values in said:
        row = _VIDEOS[statement]
        if row.verdict != "honoured":
            cure = str(values.get("cure", row.rule.partition("; ")[2]))
            if not cure or cure.startswith("-"):
                cure = f"this makes such a file: {_command(path, cure, values)}"
            notes[row.said(path, visible_line(found), cure)] = None
    return list(notes)


def _command(path: Path, options: str, values: Mapping[str, object]) -> str:
    mended = path.with_name(f"{path.stem}-mended.mov")
    words = ["ffmpeg", str(values.get("decoder", "")), "-i", shlex.quote(str(path))]
    words += ["-map 0:v:0 -map_metadata -1", options.format_map({"aspect": "sar", **values})]
    words += ["-c:v ffv1 -pix_fmt bgr0", shlex.quote(str(mended))]
    return " ".join(filter(None, words))
