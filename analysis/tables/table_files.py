"""Files of tables as rows of text: CSV however it is encoded, spreadsheets, folders of both.

What is changed is said, a note for each kind of change; what is plain already is left as it is.
Tables are written as CSV that spreadsheets show and do not run (docs/decisions/0165).
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import pandas as pd

from analysis.tables.counts import HEADER, Counted, decisions_of, is_square
from analysis.tables.spreadsheet import ENDINGS, read_spreadsheet
from protocols.disk.whole_file import decoded_text, read_bytes, separator_of
from protocols.errors import StudyError, count_of
from protocols.limits import FIXED, check_cells, check_within
from protocols.outside import CONTROL, lines_of, original_cell, safe_cell

TABLES = (".csv", ".tsv", *ENDINGS)
"""Tables that a folder may hold."""
SPREADSHEETS = (".xls", ".numbers")
"""Spreadsheets that are not read."""
FIRST_LINE = 2
SHOWN_LETTERS = 60
_ZIPPED = b"PK\x03\x04"
_LIST = re.compile(r"""\[\s*(?:'([^']*)'|"([^"]*)"|([-+\d.eE]+))?\s*,?\s*\]""")
_DECIMAL = re.compile(r"[+-]?\d+,\d+(\s*(%|m?s|deg))?")
_NUMBER = re.compile(r"[+-]?\d+(,\d+)?(\s*(%|m?s|deg))?")
_SAME_ROWS = 4
"""Files with so many rows or more are not the same by chance."""

Rows = list[list[str]]
MOST_COLUMNS = FIXED["columns"].most


@dataclass
class FileRows:
    """Header and rows of text of a file or a folder, where each row stands, and what was changed.

    `lines` holds the file and the line of every row; there are no blank ones.
    """

    header: list[str] = field(default_factory=list)
    rows: Rows = field(default_factory=list)
    lines: list[tuple[Path, int]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def rows_of(path: Path, counted: Counted | None = None) -> FileRows:
    """Return the rows of a table, or of all tables in a folder with the columns of all.

    Read are UTF-8, UTF-16 and Windows' Latin-1; comma, semicolon or tab; and the first sheet of
    ``.xlsx`` and ``.ods``, however it is named. Columns of numbers with decimal commas get points
    where the file is separated otherwise. With `counted`, a square table of counts is read as such:
    then a file is a participant.

    Raises
    ------
    StudyError
        If it is a spreadsheet of another kind, cannot be read, has no header, a name twice, or a
        row that is longer or shorter than the header; of a folder, if it holds no table, or one
        twice.
    """
    if not path.is_dir():
        return _of_file(path, counted)
    files = sorted(
        one
        for one in path.iterdir()
        if one.suffix.lower() in (*TABLES, *SPREADSHEETS)
        and not one.name.startswith((".", "~$"))  # of macOS, and of Excel while it runs
    )
    if not files:
        raise StudyError(f"{path}: must hold tables ({', '.join(TABLES)}) (it holds none)")
    cells: list[dict[str, str]] = []
    header: dict[str, None] = {}
    told: dict[str, list[str]] = {}
    seen: dict[tuple[tuple[str, ...], ...], Path] = {}
    found = FileRows(notes=[f"{len(files)} tables of {path} read as one"])
    for file in files:
        one = FileRows(notes=["left out: it is empty"])
        if file.stat().st_size:
            one = _of_file(file, counted)
        same = tuple(map(tuple, one.rows))
        if len(same) >= _SAME_ROWS and seen.setdefault(same, file) != file:
            raise StudyError(
                f"{file}: must hold rows of its own (they are those of {seen[same].name}); move one"
                " of both out of the folder"
            )
        header |= dict.fromkeys(one.header)
        # Each row gets the columns of all tables.
        count = (len(cells) + len(one.rows)) * len(header)
        check_within("cells", count, StudyError, path, "cells")
        cells += (dict(zip(one.header, row, strict=True)) for row in one.rows)
        found.lines += one.lines
        for note in one.notes:
            told.setdefault(note.partition(":")[0], []).append(f"{file.name}: {note}")
    found.header = list(header)
    found.rows = [[row.get(name, "") for name in header] for row in cells]
    for first, *others in told.values():
        found.notes.append(first + (f"; likewise in {len(others)} more" if others else ""))
    return found


def _of_file(path: Path, counted: Counted | None) -> FileRows:
    """Return the rows of one file."""
    if path.suffix.lower() in SPREADSHEETS:
        raise StudyError(
            f"{path}: must be a CSV table, {' or '.join(ENDINGS)}; save it as one of them in the"
            " spreadsheet's own program"
        )
    found = FileRows()
    if _is_spreadsheet(path):
        numbered, separator = list(enumerate(read_spreadsheet(path, found.notes), 1)), ";"
    else:
        numbered, separator = _read_text(path, found.notes)
    (_, head), *body = numbered or [(1, [])]
    found.header = [original_cell(name).strip("\ufeff \t") for name in head]
    if not any(found.header):
        raise StudyError(f"{path}: must be a CSV table with a header (found none)")
    if len(found.header) > MOST_COLUMNS:
        raise StudyError(
            f"{path}: must have at most {MOST_COLUMNS:,} columns, as spreadsheets do (has"
            f" {len(found.header):,}); write one trial a row"
        )
    twice = sorted(name for name, count in Counter(found.header).items() if count > 1)
    if twice:
        raise StudyError(f"{path}: columns must have names of their own (twice: {twice})")
    again = []
    titles = [at for at, (_, row) in enumerate(body[:2]) if _is_qualtrics(row)]
    if titles:
        titles = [line for line, _ in body[: titles[0] + 1]]
        body = body[len(titles) :]
        found.notes.append(
            f"left out, Qualtrics' further lines of the header: {counted_lines(titles)}"
        )
    for line, row in body:
        if not any(map(str.strip, row)):
            continue
        if len(row) != len(found.header):
            raise StudyError(
                f"{path}: line {line}: must have {len(found.header)} cells like the header (found"
                f" {len(row)}); a separator at its end counts as a cell"
            )
        if [cell.strip("\ufeff \t") for cell in row] == found.header:
            again.append(line)
            continue
        found.rows.append(
            # Most cells are plain, and need not be looked at twice.
            [
                cell
                if cell.isprintable() and not cell.startswith("'")
                else original_cell(" ".join(cell.splitlines()))
                for cell in row
            ]
        )
        found.lines.append((path, line))
    if again:
        found.notes.append(f"left out, the header again: {counted_lines(again)}")
    if separator != ",":
        found.notes += _decimal_points(found)
    found.notes += _lone_entries(found)
    if counted is not None and is_square(path, found.header, found.rows):
        lines = [line for _, line in found.lines]
        each = list(decisions_of(path, found.header, found.rows, lines, counted))
        what = (
            f"{found.header[0] or 'the row'}'s was chosen over the column's"
            if counted == "choices"
            else "the column was answered where the row was right"
        )
        found.notes.append(
            f"counts of {count_of(len(each), 'decision')}, {what}; a table of counts says neither"
            f" who decided (all stand as the participant {path.stem!r}) nor in which order"
        )
        found.header, found.rows = HEADER[counted], [row for _, row in each]
        found.lines = [(path, line) for line, _ in each]
    return found


def counted_lines(lines: Sequence[int | str]) -> str:
    """Return the number of rows, with the first places: ``2 rows (lines 3, 5)``."""
    shown = ", ".join(map(str, lines[:5])) + " ..." * (len(lines) > 5)
    several = "s" * (len(lines) != 1)
    return f"{len(lines)} row{several} (line{several} {shown})"


def _is_spreadsheet(path: Path) -> bool:
    if path.suffix.lower() in ENDINGS or not path.is_file():
        return path.suffix.lower() in ENDINGS
    with path.open("rb") as file:
        return file.read(len(_ZIPPED)) == _ZIPPED


def _read_text(path: Path, notes: list[str]) -> tuple[list[tuple[int, list[str]]], str]:
    """Return the rows of a text file with their lines, and what separates their cells."""
    text = decoded_text(read_bytes(path, "the table", "table"), notes)
    text = text if "\n" in text else text.replace("\r", "\n")  # as old Macs ended lines
    header = text.split("\n", maxsplit=1)[0]
    if header.lower().startswith("sep="):
        raise StudyError(
            f"{path}: line 1: must be the header (got {shortened(header.strip())!r}, which only"
            " spreadsheets read); delete this line"
        )
    separator = separator_of(text)
    check_cells(path, text, separator)
    if control := CONTROL.search(text):
        line = text.count("\n", 0, control.start()) + 1
        raise StudyError(
            f"{path}: line {line}: must hold no control characters (got {control.group()!a})"
        )
    reader = csv.reader(lines_of(text), delimiter=separator)
    try:
        return [(reader.line_num, row) for row in reader], separator
    except csv.Error as error:
        raise StudyError(f"{path}: must be a CSV table with a header ({error})") from None


def _decimal_points(found: FileRows) -> list[str]:
    """Write points in columns whose values are all numbers, some with a decimal comma."""
    turned = []
    for place, name in enumerate(found.header):
        filled = [cell for row in found.rows if (cell := row[place].strip())]
        if not any(map(_DECIMAL.fullmatch, filled)) or not all(map(_NUMBER.fullmatch, filled)):
            continue
        for row in found.rows:
            row[place] = row[place].strip().replace(",", ".")
        first = next(filter(_DECIMAL.fullmatch, filled))
        turned.append(f"{name} ({first} is {first.replace(',', '.')})")
    return [f"decimal commas read as points: {', '.join(turned)}"] if turned else []


def _is_qualtrics(row: Sequence[str]) -> bool:
    """True of the line in which each cell is ``{"ImportId":"QID1"}`` or such."""
    filled = [cell.replace("'", '"') for cell in row if cell.strip()]
    return bool(filled) and all(cell.startswith('{"ImportId":') for cell in filled)


def _lone_entries(found: FileRows) -> list[str]:
    """Write the entry in the place of each list of one, such as ``['left']``; of none, nothing."""
    turned: dict[str, None] = {}
    for row in found.rows:
        for place, cell in enumerate(row):
            if "[" in cell and (entry := _LIST.fullmatch(cell.strip())):
                row[place] = "".join(filter(None, entry.groups()))
                turned[found.header[place]] = None
    return [f"lists of one read as their entry: {', '.join(turned)}"] if turned else []


def shortened(text: object) -> str:
    """Return a value as a message shows it: its beginning, where it is very long."""
    shown = str(text)
    return shown if len(shown) <= SHOWN_LETTERS else shown[:SHOWN_LETTERS] + "..."


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Write a table as CSV that spreadsheets show and do not run.

    A text that begins with = + - @ or a control character gets an apostrophe in front, as does one
    that begins so after apostrophes; `rows_of` takes one away again. Other control
    characters, which it refuses, are spelt out. Numbers stay numbers.
    """
    safe = table.copy()
    for place, kind in enumerate(table.dtypes):
        if not pd.api.types.is_numeric_dtype(kind):
            safe.isetitem(place, table.iloc[:, place].map(_cell).to_numpy())
    safe.columns = pd.Index([_cell(name) for name in table.columns])
    safe.to_csv(path, index=False, lineterminator="\n", errors="backslashreplace")


def _cell(value: object) -> object:
    return _text_cell(value) if isinstance(value, str) else value


@lru_cache(maxsize=1024)  # names and dates come many times
def _text_cell(text: str) -> object:
    return safe_cell(CONTROL.sub(lambda found: ascii(found.group())[1:-1], text))
