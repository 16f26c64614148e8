"""Tables as other tools and spreadsheets write them, in the plain form that analyses read.

What is changed is said, a note for each kind of change; what is plain already is left as it is.
"""

from __future__ import annotations

import csv
import re
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from analysis.csv_table import ZIPPED, separator_of, with_lines
from analysis.xlsx import ENDING, read_xlsx
from protocols.errors import StudyError
from protocols.limits import check_cells
from protocols.load import read_bytes
from protocols.outside import check_within, lines_of

TABLES = (".csv", ".tsv", ENDING)
"""Tables that a folder may hold."""
SPREADSHEETS = (".xls", ".ods", ".numbers")
"""Spreadsheets that are not read."""
ANSWERS = ("chosen", "chose_first", "answer", "correct", "rating")
FIRST = {"first", "left", "1", "a"}
SECOND = {"second", "right", "2", "b"}
_DECIMAL = re.compile(r"[+-]?\d+,\d+")
_NUMBER = re.compile(r"[+-]?\d+(,\d+)?")
_SHOWN_LINES = 5


Rows = list[list[str]]


@dataclass(frozen=True)
class PlainForm:
    """A table in plain form.

    Parameters
    ----------
    path : Path
        Of the plain table: the user's own where nothing was changed, else a copy that is gone when
        the block ends.
    notes : tuple of str
        What was changed.
    """

    path: Path
    notes: tuple[str, ...]


@contextmanager
def in_plain_form(path: Path, mapping: Mapping[str, str]) -> Iterator[PlainForm]:
    """Give a table as UTF-8 with commas and decimal points, without rows that have no answer.

    Read are UTF-8, UTF-16 with a mark and Windows' Latin-1, and the first sheet of ``.xlsx``,
    however it is named. A column of numbers with decimal commas gets points where the file is
    separated otherwise. Where the column ``chosen`` says left and right, or first and second, it
    gets the names of the columns ``first`` and ``second``. Of a folder all tables are read as one,
    with the columns of all. Errors inside the block name the user's file and its line.

    Parameters
    ----------
    mapping : mapping of our name to the file's column
        As `analysis.csv_table.renamed` takes it.

    Raises
    ------
    StudyError
        If it is a spreadsheet of another kind, or cannot be read; of a folder, if it holds no
        table.
    """
    if not path.is_dir():
        rows, notes = _plain_rows(path, mapping)
        lines = [(path, line) for line in range(1, len(rows) + 1)]
        if not notes and not _is_spreadsheet(path):
            yield PlainForm(path, ())
            return
    else:
        rows, lines, notes = _rows_of_folder(path, mapping)
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / f"{path.resolve().stem or 'tables'}.csv"
        with plain.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            for row in rows:
                writer.writerow([" ".join(cell.splitlines()) for cell in row])
        rows.clear()  # they are read anew
        try:
            yield PlainForm(plain, tuple(notes))
        except StudyError as error:
            said = re.sub(
                rf"{re.escape(str(plain))}: line (\d+)",
                lambda found: "{}: line {}".format(*lines[int(found[1]) - 1]),
                str(error),
            )
            raise StudyError(said.replace(str(plain), str(path))) from None


def _rows_of_folder(
    path: Path, mapping: Mapping[str, str]
) -> tuple[Rows, list[tuple[Path, int]], list[str]]:
    """Return the rows of all tables in a folder, where each comes from, and what was changed."""
    files = sorted(
        one
        for one in path.iterdir()
        if one.suffix.lower() in (*TABLES, *SPREADSHEETS)
        and not one.name.startswith((".", "~$"))  # of macOS, and of Excel while it runs
    )
    if not files:
        raise StudyError(f"{path}: must hold tables ({', '.join(TABLES)}) (it holds none)")
    header: dict[str, None] = {}
    cells: list[dict[str, str]] = []
    lines = [(files[0], 1)]
    told: dict[str, list[str]] = {}
    for file in files:
        rows, notes = _plain_rows(file, mapping)
        if not rows:
            notes.append("left out: it is empty")
        names = [name.strip() for name in rows[0]] if rows else []
        if len(set(names)) < len(names):
            raise StudyError(f"{file}: columns must have names of their own")
        header |= dict.fromkeys(names)
        # Each row gets the columns of all tables.
        count = (len(cells) + len(rows)) * len(header)
        check_within("cells", count, StudyError, path, "cells")
        for line, row in enumerate(rows[1:], start=2):
            if row and len(row) != len(names):
                raise StudyError(
                    f"{file}: line {line}: must have {len(names)} cells like the header (found"
                    f" {len(row)})"
                )
            if row:
                cells.append(dict(zip(names, row, strict=True)))
                lines.append((file, line))
        for note in notes:
            told.setdefault(note.partition(":")[0], []).append(f"{file.name}: {note}")
    rows = [list(header), *([row.get(name, "") for name in header] for row in cells)]
    notes = [f"{len(files)} tables of {path} read as one"]
    for one, *others in told.values():
        notes.append(one + (f"; likewise in {len(others)} more" if others else ""))
    return rows, lines, notes


def _plain_rows(path: Path, mapping: Mapping[str, str]) -> tuple[Rows, list[str]]:
    """Return the rows of one file by line, in plain form, and what was changed."""
    if path.suffix.lower() in SPREADSHEETS:
        raise StudyError(
            f"{path}: must be a CSV table or {ENDING}; save it as one of them in the spreadsheet's"
            " own program"
        )
    notes: list[str] = []
    if _is_spreadsheet(path):
        rows, separator = read_xlsx(path, notes), ";"
    else:
        rows, separator = _read_text(path, notes)
    for change in (_decimal_points, _answers_by_place, _without_empty):
        notes += change(rows, separator, mapping)
    return rows, notes


def _is_spreadsheet(path: Path) -> bool:
    if path.suffix.lower() == ENDING or not path.is_file():
        return path.suffix.lower() == ENDING
    with path.open("rb") as file:
        return file.read(len(ZIPPED)) == ZIPPED


def _read_text(path: Path, notes: list[str]) -> tuple[list[list[str]], str]:
    """Return the rows of a text file by line, and what separates its cells."""
    data = read_bytes(path, "the table", "table")
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = data.decode("utf-16", "replace")
        notes.append("read as UTF-16")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252", "replace")
            notes.append("read as Windows' Latin-1: it is no UTF-8; look whether names are right")
    text = with_lines(text)
    separator = separator_of(path, text)
    check_cells(path, text, separator)
    reader = csv.reader(lines_of(text), delimiter=separator)
    rows: list[list[str]] = []
    try:
        for row in reader:
            rows += [[] for _ in range(reader.line_num - len(rows) - 1)]
            rows.append(row)
    except csv.Error as error:
        raise StudyError(f"{path}: must be a CSV table with a header ({error})") from None
    return rows, separator


def _decimal_points(
    rows: list[list[str]], separator: str, _mapping: Mapping[str, str]
) -> list[str]:
    """Write points in columns whose values are all numbers, some with a decimal comma."""
    if separator == "," or not rows:
        return []
    turned = []
    for place, name in enumerate(rows[0]):
        cells = [row[place].strip() for row in rows[1:] if len(row) > place]
        filled = [cell for cell in cells if cell]
        if not any(_DECIMAL.fullmatch(cell) for cell in filled):
            continue
        if not all(_NUMBER.fullmatch(cell) for cell in filled):
            continue
        for row in rows[1:]:
            if len(row) > place:
                row[place] = row[place].strip().replace(",", ".")
        turned.append(name.strip())
    return [f"decimal commas read as points: {', '.join(turned)}"] if turned else []


def _answers_by_place(
    rows: list[list[str]], _separator: str, mapping: Mapping[str, str]
) -> list[str]:
    """Put names in the place of left and right, or first and second, in the column `chosen`."""
    places = _places(rows, mapping)
    if not {"first", "second", "chosen"} <= places.keys():
        return []
    first, second, chosen = (places[name] for name in ("first", "second", "chosen"))
    whole = [row for row in rows[1:] if len(row) == len(rows[0])]
    said = {row[chosen].strip().lower() for row in whole} - {""}
    named = {row[column].strip().lower() for row in whole for column in (first, second)}
    if not said or not said <= FIRST | SECOND or said & named:
        return []
    for row in whole:
        answer = row[chosen].strip().lower()
        if answer:
            row[chosen] = row[first if answer in FIRST else second]
    theirs = rows[0][chosen].strip()
    return [
        f"{theirs} says {' and '.join(sorted(said))}: read as the columns"
        f" {rows[0][first].strip()} and {rows[0][second].strip()}"
    ]


def _without_empty(rows: list[list[str]], _separator: str, mapping: Mapping[str, str]) -> list[str]:
    """Leave out rows without any cell, and rows without an answer, or a time where only that is."""
    places = _places(rows, mapping)
    answers = [places[name] for name in ANSWERS if name in places]
    answers = answers or [places[name] for name in ("rt_s",) if name in places]
    lines = []
    for line, row in enumerate(rows[1:], start=2):
        blank = not any(cell.strip() for cell in row)
        unanswered = len(row) == len(rows[0]) and any(not row[place].strip() for place in answers)
        # Of two columns that say the answer one may be empty.
        if len(answers) > 1 and any(
            row[place].strip() for place in answers if len(row) == len(rows[0])
        ):
            unanswered = False
        if row and (blank or unanswered):
            row.clear()
            lines += [] if blank else [line]
    if not lines:
        return []
    more = " ..." if len(lines) > _SHOWN_LINES else ""
    shown = ", ".join(map(str, lines[:_SHOWN_LINES])) + more
    count = f"{len(lines)} row{'s' * (len(lines) != 1)}"
    return [f"left out without an answer: {count} (line {shown})"]


def _places(rows: list[list[str]], mapping: Mapping[str, str]) -> dict[str, int]:
    """Return in which column each of our names stands."""
    header = [name.strip() for name in rows[0]] if rows else []
    wanted = {name: name for name in (*ANSWERS, "rt_s", "first", "second")} | dict(mapping)
    return {ours: header.index(theirs) for ours, theirs in wanted.items() if theirs in header}
