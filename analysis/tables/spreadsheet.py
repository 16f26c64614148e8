"""The first sheet of an .xlsx or .ods file as rows of text, read by python-calamine.

It takes memory for every cell up to the last filled one, and for a text as often as it is used. So
the parts of a file are held to the limits before, and it is given these parts alone.
"""

from __future__ import annotations

import datetime
import io
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

from python_calamine import CalamineWorkbook

from protocols.errors import StudyError
from protocols.limits import FIXED, check_within
from protocols.outside import check_zip, reading

ENDINGS: Final = (".xlsx", ".ods")
_PARTS: Final = (
    "_rels/", "[content_types].xml", "xl/_rels/", "xl/workbook.xml", "xl/styles.xml",
    "xl/sharedstrings.xml", "xl/worksheets/", "mimetype", "meta-inf/", "content.xml",
)  # fmt: skip
"""Beginnings of the names of the parts that say something of cells."""
_ERROR: Final = re.compile(rb"""(<(?:\w+:)?c\b[^<>]*\bt\s*=\s*["'])e(?=["'])""")
_CELL: Final = (
    rb'(<(?:\w+:)?c\b(?![^<>]*\st="[^n])[^<>]*\ss="(?:%s)"[^<>]*>'
    rb"(?:\s*<(?:\w+:)?f\b[^<>]*>(?:[^<]*</(?:\w+:)?f>)?)?\s*<(?:\w+:)?v>)([^<]+)"
)
"""A number of .xlsx, by its styles: what stands before it, perhaps with a formula, and it."""
_PERCENTAGE: Final = re.compile(
    rb'(<table:(?:covered-)?table-cell\b(?=[^<]*\soffice:value-type="percentage")'
    rb'[^<]*?\soffice:value=")([^"]+)'
)
_LITERAL: Final = re.compile(r'"[^"]*"|\\.')
_PLACE: Final = re.compile(r"([A-Z]{1,3})(\d{1,7})")
_MOST_COLUMNS, _MOST_ROWS, _MOST_LETTERS = (
    FIXED[name].most for name in ("columns", "sheet_rows", "cell")
)
"""Limits of a sheet and of a cell, as Excel has them."""
_DEEPEST: Final = 100
_PIECE: Final = 1 << 20
_ELEMENTS: Final = 3
"""For each cell that a table may have: its own, its value's, and one for its row and its style."""


class DateText(str):
    """Text of a cell that is a date or a time."""

    __slots__ = ()


def read_spreadsheet(path: Path, notes: list[str]) -> list[list[str]]:
    """Return the rows of the first sheet; blank rows are empty lists.

    Formulas give the value that was stored with them, dates and times a `DateText`, numbers shown
    as percentages a text such as ``43%``. `notes` is told where there are more sheets.

    Raises
    ------
    StudyError
        If it is no such file, or holds more than the limits.
    """
    ending = path.suffix.lower() if path.suffix.lower() in ENDINGS else ENDINGS[0]
    with reading(path, f"an {ending} file", StudyError), path.open("rb") as file:
        check_zip(path, file, StudyError)
        held = _held(path, file)
        try:
            with CalamineWorkbook.from_filelike(held) as book:
                names = book.sheet_names
                if not names:
                    raise StudyError(f"{path}: must have a sheet (has none)")
                sheet = book.get_sheet_by_index(0).to_python(skip_empty_area=False)
        except BaseException as error:
            if type(error).__name__ != "PanicException":  # of Rust, and no Exception
                raise
            raise ValueError(error) from None
    if len(names) > 1:
        notes.append(f"the first of {len(names)} sheets was read: {names[0]}")
    rows: list[list[str]] = []
    width = 0
    for values in sheet:
        cells = list(map(_text, values))
        filled = next((k for k in range(len(cells), 0, -1) if cells[k - 1].strip()), 0)
        width = width or filled  # the header says how wide the table is
        rows.append(cells[: max(filled, width)] if filled else [])
    return rows


def _text(value: object) -> str:
    if isinstance(value, (bool, int, float)):
        return f"{value:.15g}"  # Excel's own digits: 0.1 is 0.10000000000000001
    dated = isinstance(value, (datetime.date, datetime.time, datetime.timedelta))
    return DateText(value) if dated else str(value)


def _held(path: Path, file: io.BufferedReader) -> io.BytesIO:
    """Return a file of those parts that say something of cells, held to the limits."""
    made = io.BytesIO()
    with (
        zipfile.ZipFile(file) as packed,
        zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as held,
    ):
        parts = {
            one.filename: one
            for one in packed.infolist()
            if one.filename.lower().startswith(_PARTS)
        }
        size = sum(one.file_size for one in parts.values())
        check_within("text", size, StudyError, path, "bytes in its sheets")
        extent = _Extent(path)
        # What cells share comes first.
        shared = ("xl/shared", "xl/styles")
        for name in sorted(parts, key=lambda name: not name.lower().startswith(shared)):
            data = packed.read(name)
            if not name.endswith("mimetype"):
                extent.hold(data)
            data = _PERCENTAGE.sub(_percentage, _ERROR.sub(rb"\1str", data))  # errors are texts
            if styles := extent.percentages():
                data = re.sub(_CELL % b"|".join(styles), _percentage, data)
            held.writestr(name, data)
    made.seek(0)
    return made


def _percentage(found: re.Match[bytes]) -> bytes:
    """Return the beginning of a cell as a text, with the percentage that it shows."""
    start = found[1].replace(b' t="n"', b"")
    start = start.replace(b' office:value="', b' office:string-value="')
    return start + f"{100 * float(found[2]):.15g}%".encode()


class _Extent:
    """Receiver of what a parser finds: extent and letters of sheets, and styles of percentages."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._elements = self._area = 0
        self._shared: list[int] = []
        self._formats, self._styles = {"9", "10"}, list[str]()

    def percentages(self) -> list[bytes]:
        """Return the styles of cells that show numbers as percentages."""
        return [str(k).encode() for k, one in enumerate(self._styles) if one in self._formats]

    def hold(self, data: bytes) -> None:
        """Look through a part.

        Raises
        ------
        StudyError, ValueError, ElementTree.ParseError
            If it is more than the limits, or no plain XML.
        """
        self._depth = self._cell = self._letters = self._sum = 0
        self._row = self._rows = self._column = self._columns = self._width = 0
        self._place: str | None = None
        parser = ElementTree.XMLParser(target=self)
        for first in range(0, len(data), _PIECE):
            parser.feed(data[first : first + _PIECE])
            check_within("cells", self._elements // _ELEMENTS, StudyError, self._path, "cells")
            check_within("cells", self._area, StudyError, self._path, "cells up to the last one")
            check_within("table", self._sum, StudyError, self._path, "characters")
        parser.close()

    def doctype(self, name: str, *_: object) -> None:
        """Refuse: it may declare entities."""
        raise ValueError(f"it declares a document type, {name}")

    def start(self, tag: str, attributes: Mapping[str, str]) -> None:
        """Go on to a row, a column or a text."""
        self._elements += 1
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ValueError(f"its elements lie more than {_DEEPEST} deep")
        said = {name.rpartition("}")[2]: value for name, value in attributes.items()}
        match tag.rpartition("}")[2]:
            case "table" | "worksheet":
                self._row = self._rows = self._width = self._sum = 0
            case "row" | "table-row":
                row = int(said.get("r", self._row + self._rows + 1))
                if not self._row + self._rows < row <= _MOST_ROWS:
                    raise StudyError(f"{self._path}: rows must be numbered upwards (got {row})")
                self._row, self._rows = row, int(said.get("number-rows-repeated", 1)) - 1
                self._column = self._columns = 0
            case "c" | "table-cell" | "covered-table-cell":
                self._column += self._columns + 1
                if "r" in said:
                    place = _PLACE.fullmatch(said["r"])
                    if place is None or int(place[2]) != self._row:
                        raise ValueError(f"a cell of row {self._row} is said to be {said['r']!r}")
                    self._column = _number(place[1])
                self._columns = int(said.get("number-columns-repeated", 1)) - 1
                self._cell, self._letters = self._depth, len(said.get("string-value", ""))
                self._place = "" if said.get("t") == "s" else None
            case "v" | "is" | "p":
                self._width = max(self._width, self._column + self._columns)
                if self._width > _MOST_COLUMNS:
                    raise StudyError(f"{self._path}: row {self._row}: has too many columns")
                self._area = max(self._area, self._width * (self._row + self._rows))
            case "numFmt" if "%" in _LITERAL.sub("", said.get("formatCode", "")):
                self._formats.add(said.get("numFmtId", ""))
            case "cellXfs":
                self._styles.clear()  # those before are of named styles
            case "xf":
                self._styles.append(said.get("numFmtId", ""))
            case "si":
                self._cell, self._letters, self._place = self._depth, 0, None
            case "s":
                self.data(" " * min(int(said.get("c", 1)), _MOST_LETTERS + 1))

    def end(self, tag: str) -> None:
        """Leave an element; count the letters of a cell as often as it is repeated."""
        if self._cell == self._depth:
            self._cell = 0
            if tag.endswith("}si"):
                self._shared.append(self._letters)
            else:
                again = (self._rows + 1) * (self._columns + 1)
                self._sum += again * (
                    self._shared[int(self._place)] if self._place else self._letters
                )
        self._depth -= 1

    def data(self, text: str) -> None:
        """Count the letters of a cell, or keep the place of a text that cells share."""
        if not self._cell:
            return
        if self._place is not None:
            self._place += text
        self._letters += len(text)
        if self._letters > _MOST_LETTERS:
            raise ValueError(f"a cell has more than {_MOST_LETTERS:,} characters")


def _number(letters: str) -> int:
    number = 0
    for letter in letters:
        number = 26 * number + ord(letter) - ord("A") + 1
    return number
