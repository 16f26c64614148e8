"""CSV files of other tools as tables of text, and their columns as checked values.

The index of a table is the line of the file minus 2, so that line numbers in messages hold
whatever was left out.
"""

import csv
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from protocols.errors import StudyError
from protocols.limits import check_cells
from protocols.load import decode_utf8, read_bytes
from protocols.outside import CONTROL, lines_of, original_cell, safe_cell
from protocols.suggest import did_you_mean

FIRST_LINE = 2
LARGEST_WHOLE = 2**53
"""Beyond, tables of numbers do not tell neighbours apart."""
DAY_S = 86_400.0
SHOWN_LETTERS = 60
IMPORT_HINT = "say which column holds it: metamerlab analysis import TABLE --map"
"""Cure of a missing column, for `analysis import` and for `analysis report`, which takes no map."""
ZIPPED = b"PK\x03\x04"
"""How spreadsheets (.xlsx) begin."""
PLAIN_HINT = "bring it in with 'metamerlab analysis import'"
"""Cure of a table in another form than plain CSV."""


def read_table(path: Path) -> pd.DataFrame:
    """Read a CSV file with a header as text; comma, semicolon or tab, UTF-8.

    Raises
    ------
    StudyError
        If it has no header, a name twice, or a row that is longer or shorter than the header.
    """
    data = read_bytes(path, "the table", "table")
    if path.suffix.lower() == ".xlsx" or data.startswith(ZIPPED):
        named = "" if path.suffix.lower() == ".xlsx" else "name it .xlsx, and "
        raise StudyError(
            f"{path}: must be a CSV table (this is a spreadsheet); {named}{PLAIN_HINT}"
        )
    try:
        text = decode_utf8(data, path)
    except StudyError as error:
        raise StudyError(f"{error}, or {PLAIN_HINT}") from None
    text = with_lines(text)
    separator = separator_of(path, text)
    check_cells(path, text, separator)
    if found := CONTROL.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise StudyError(
            f"{path}: line {line}: must hold no control characters (got {found.group()!a})"
        )
    reader = csv.reader(lines_of(text), delimiter=separator)
    try:
        header = [original_cell(name).strip() for name in next(reader, [])]
        rows: list[list[str]] = []
        lines: list[int] = []
        for row in reader:
            if not row:
                continue
            if len(row) != len(header):
                raise StudyError(
                    f"{path}: line {reader.line_num}: must have {len(header)} cells like the"
                    f" header (found {len(row)}); a separator at its end counts as a cell"
                )
            rows.append([original_cell(cell) for cell in row])
            lines.append(reader.line_num - FIRST_LINE)
    except csv.Error as error:
        raise StudyError(f"{path}: must be a CSV table with a header ({error})") from None
    if not any(header):
        raise StudyError(f"{path}: must be a CSV table with a header (found none)")
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise StudyError(f"{path}: columns must have names of their own (twice: {twice})")
    return pd.DataFrame(rows, columns=header, index=lines, dtype=str)


def with_lines(text: str) -> str:
    """Return a text whose lines end as today's do, also where old Macs ended them."""
    return text if "\n" in text else text.replace("\r", "\n")


def separator_of(path: Path, text: str) -> str:
    """Return what separates the cells of a table: comma, semicolon or tab, by its header.

    Raises
    ------
    StudyError
        If the first line is no header but a word to spreadsheets, such as ``sep=;``.
    """
    header = text.split("\n", maxsplit=1)[0]
    if header.lower().startswith("sep="):
        raise StudyError(
            f"{path}: line 1: must be the header (got {shortened(header.strip())!r}, which only"
            " spreadsheets read); delete this line"
        )
    return max(",;\t", key=header.count)


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Write a table as CSV that spreadsheets show and do not run (docs/decisions/0165).

    A text that begins with = + - @ or a control character gets an apostrophe in front, as does one
    that begins so after apostrophes; `read_table` takes one away again. Other control characters,
    which `read_table` refuses, are spelt out. Numbers stay numbers.
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


def renamed(
    path: Path, table: pd.DataFrame, mapping: Mapping[str, str], known: Sequence[str] | None
) -> pd.DataFrame:
    """Return the table with copies of columns under our names.

    `known` are the names that may be given; None: any.
    """
    for ours, theirs in mapping.items():
        if known is not None and ours not in known:
            raise StudyError(
                f"--map {ours}={theirs}: must name one of {', '.join(known)}"
                f"{did_you_mean(ours, known)}"
            )
        if theirs not in table.columns:
            raise StudyError(
                f"{path}: must have the column {theirs!r} mapped to {ours}"
                f" (found: {', '.join(map(str, table.columns))})"
                f"{did_you_mean(theirs, list(map(str, table.columns)))}"
            )
    named = table.copy()
    for ours, theirs in mapping.items():
        named[ours] = table[theirs]
    return named


def need_columns(path: Path, table: pd.DataFrame, missing: Sequence[str], cure: str = "") -> None:
    """Refuse a table without columns it needs; the first word of each is its name."""
    if missing:
        first, found = missing[0].split()[0], list(map(str, table.columns))
        raise StudyError(
            f"{path}: must have the columns {', '.join(missing)}{cure}"
            f" (found: {', '.join(found)}); {IMPORT_HINT} {first}=COLUMN"
            f"{did_you_mean(first, found)}"
        )


def refuse_rows(
    path: Path, wrong: pd.Series, must: str | Callable[[Any], str], got: pd.Series | None = None
) -> None:
    """Refuse the first row that is wrong: what must hold, or what its index says, and its value."""
    if wrong.any():
        at = wrong.index[wrong][0]
        said = must if isinstance(must, str) else must(at)
        found = "" if got is None else f" (got {shortened(got[at])!r})"
        raise StudyError(f"{path}: line {at + FIRST_LINE}: {said}{found}")


def refuse_equals(path: Path, rows: pd.DataFrame) -> None:
    """Refuse a comparison of something with itself."""
    refuse_rows(
        path,
        rows["first"] == rows["second"],
        lambda at: f"first and second must differ (got {shortened(rows['first'][at])!r} twice)",
    )


def text_column(path: Path, table: pd.DataFrame, column: str) -> pd.Series:
    """Return a column of texts, none of them empty."""
    values = table[column].str.strip()
    refuse_rows(path, values == "", f"{column} must not be empty")
    return values


def number_column(path: Path, table: pd.DataFrame, column: str) -> pd.Series:
    """Return a column of finite numbers; an empty cell is NaN."""
    raw = table[column].str.strip()
    values = pd.to_numeric(raw, errors="coerce")
    refuse_rows(
        path,
        (raw != "") & ~np.isfinite(values.astype(float)),
        lambda at: (
            f"{column} must be a number (got {shortened(raw[at])!r})"
            + (f"; write decimals with a point, or {PLAIN_HINT}" if "," in raw[at] else "")
        ),
    )
    return values


def whole_column(path: Path, table: pd.DataFrame, column: str) -> pd.Series:
    """Return a column of whole numbers from 0 on; an empty cell is NaN."""
    values = number_column(path, table, column).astype(float)
    wrong = ((values != values.round()) & values.notna()) | (values < 0) | (values > LARGEST_WHOLE)
    refuse_rows(path, wrong, f"{column} must be a whole number from 0 on", table[column])
    return values


def flag_column(path: Path, table: pd.DataFrame, column: str) -> pd.Series:
    """Return a column of 0 and 1, none of them empty."""
    values = number_column(path, table, column)
    refuse_rows(path, ~values.isin((0, 1)), f"{column} must be 1 or 0", table[column])
    return values.astype("int64")


def seconds_column(path: Path, table: pd.DataFrame, column: str) -> pd.Series:
    """Return a column of durations above 0 and below a day; an empty cell is NaN."""
    values = number_column(path, table, column).astype(float)
    must = f"{column} must be above 0 seconds and below a day"
    refuse_rows(path, (values <= 0) | (values >= DAY_S), must, table[column])
    return values


def shortened(text: object) -> str:
    """Return a value as a message shows it: its beginning, where it is very long."""
    shown = str(text)
    return shown if len(shown) <= SHOWN_LETTERS else shown[:SHOWN_LETTERS] + "..."
