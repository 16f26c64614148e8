"""The first sheet of an .xlsx file as rows of text.

Office Open XML (ECMA-376, part 1, 18.3 sheets and 18.4 shared strings), as far as values go:
formulas give the value that was stored with them, dates their number, styles nothing.
"""

from __future__ import annotations

import re
import zipfile
from pathlib import Path
from typing import TypeVar
from xml.etree import ElementTree

from protocols.errors import StudyError
from protocols.limits import FIXED, check_within, limit
from protocols.outside import check_zip, reading

ENDING = ".xlsx"
_MAIN = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"
_LINK = "{http://schemas.openxmlformats.org/officeDocument/2006/relationships}id"
_TEXTS, _SPOKEN = {f"{_MAIN}t", f"{_MAIN}v"}, f"{_MAIN}rPh"
_PLACE = re.compile(r"([A-Z]{1,3})(\d{1,7})")
_MOST_COLUMNS, _MOST_ROWS, _MOST_LETTERS = (
    FIXED[name].most for name in ("columns", "sheet_rows", "cell")
)
"""Of a sheet and of a cell, as Excel has them."""
_DEEPEST = 100
_PIECE = 1 << 20
_ELEMENTS = 3
"""For each cell that a table may have: its own, its value's, and one for its row and its style."""


def read_xlsx(path: Path, notes: list[str]) -> list[list[str]]:
    """Return the rows of the first sheet; blank rows are empty lists.

    `notes` is told where there are more sheets.

    Raises
    ------
    StudyError
        If it is no such file, or unpacks to more than the limit.
    """
    with (
        reading(path, "an .xlsx file", StudyError),
        path.open("rb") as file,
    ):
        check_zip(path, file, StudyError)
        with zipfile.ZipFile(file) as packed:
            names = set(packed.namelist())
            book = _parsed(path, packed, "xl/workbook.xml", _Kept({f"{_MAIN}sheet"}))
            links = _parsed(path, packed, "xl/_rels/workbook.xml.rels", _Kept(None))
            if not book.found:
                raise StudyError(f"{path}: must have a sheet (has none)")
            targets = {entry.get("Id"): entry.get("Target", "") for entry in links.found}
            target = targets[book.found[0].get(_LINK)]
            shared: list[str] = []
            if "xl/sharedStrings.xml" in names:
                shared = _parsed(path, packed, "xl/sharedStrings.xml", _Strings()).found
            place = target.lstrip("/") if target.startswith("/") else f"xl/{target}"
            rows = _parsed(path, packed, place, _Rows(path, shared)).found
    if len(book.found) > 1:
        notes.append(
            f"the first of {len(book.found)} sheets was read: {book.found[0].get('name', '')}"
        )
    return rows


T = TypeVar("T", bound="_Target")


def _parsed(path: Path, packed: zipfile.ZipFile, name: str, target: T) -> T:
    """Give a part of the file to a target piece by piece, so that no tree is made of it."""
    check_within("text", packed.getinfo(name).file_size, StudyError, path, f"bytes in {name}")
    parser = ElementTree.XMLParser(target=target)
    most = _ELEMENTS * limit("cells")
    with packed.open(name) as part:
        while piece := part.read(_PIECE):
            parser.feed(piece)
            if target.elements > most:
                raise StudyError(
                    f"{path}: must have at most {most:,} elements in {name} (has more)"
                )
    parser.close()
    return target


class _Target:
    """Receiver of what a parser of XML finds: a beginning, a text, an end."""

    def __init__(self) -> None:
        self.elements = 0

    def start(self, tag: str, attributes: dict[str, str]) -> None:  # noqa: ARG002
        self.elements += 1

    def doctype(self, name: str, *_: object) -> None:
        """Refuse: it may declare entities."""
        raise ValueError(f"it declares a document type, {name}")


class _Kept(_Target):
    """The attributes of the elements of some tags, or of all."""

    def __init__(self, tags: set[str] | None) -> None:
        super().__init__()
        self._tags = tags
        self.found: list[dict[str, str]] = []

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        super().start(tag, attributes)
        if self._tags is None or tag in self._tags:
            self.found.append(attributes)


class _Text(_Target):
    """The text of plain or rich runs, without how it is pronounced."""

    def __init__(self) -> None:
        super().__init__()
        self._within: list[str] = []
        self._pieces: list[str] = []

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        super().start(tag, attributes)
        self._within.append(tag)
        if len(self._within) > _DEEPEST:
            raise ValueError(f"its elements lie more than {_DEEPEST} deep")

    def data(self, text: str) -> None:
        if self._within and self._within[-1] in _TEXTS and _SPOKEN not in self._within:
            self._pieces.append(text)

    def taken(self) -> str:
        """Return the text since the last time."""
        text = "".join(self._pieces)
        self._pieces.clear()
        if len(text) > _MOST_LETTERS:
            raise ValueError(f"a cell has {len(text):,} characters, more than any spreadsheet's")
        return text


class _Strings(_Text):
    """Texts that cells share."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def end(self, tag: str) -> None:
        self._within.pop()
        if tag == f"{_MAIN}si":
            self.found.append(self.taken())


class _Rows(_Text):
    """Rows of a sheet."""

    def __init__(self, path: Path, shared: list[str]) -> None:
        super().__init__()
        self._path, self._shared = path, shared
        self._number = self._width = self._count = self._letters = 0
        self._cells: list[str] = []
        self._column, self._kind = 0, "n"
        self.found: list[list[str]] = []

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        super().start(tag, attributes)
        if tag == f"{_MAIN}row":
            wanted = int(attributes.get("r", self._number + 1))
            if not self._number < wanted <= _MOST_ROWS:
                raise StudyError(f"{self._path}: rows must be numbered upwards (got {wanted})")
            self.found += ([] for _ in range(wanted - self._number - 1))
            self._number, self._cells, self._column = wanted, [], -1
        elif tag == f"{_MAIN}c":
            place = _PLACE.fullmatch(attributes.get("r", ""))
            self._column = self._column + 1 if place is None else _column(place[1])
            if self._column >= _MOST_COLUMNS:
                raise StudyError(f"{self._path}: row {self._number}: has too many columns")
            self._kind = attributes.get("t", "n")
            self._pieces.clear()

    def end(self, tag: str) -> None:
        self._within.pop()
        if tag == f"{_MAIN}c":
            if value := self._value(self.taken()):  # a cell may have a style alone
                self._cells += [""] * (self._column + 1 - len(self._cells))
                self._cells[self._column] = value
        elif tag == f"{_MAIN}row":
            cells = self._cells
            filled = next((k for k in range(len(cells), 0, -1) if cells[k - 1].strip()), 0)
            self._width = self._width or filled  # the header says how wide the table is
            width = self._width
            row = cells[: max(filled, width)] + [""] * (width - len(cells)) if filled else []
            self.found.append(row)
            self._count += len(cells) + len(row) + 1
            self._letters += sum(map(len, row))
            check_within("cells", self._count, StudyError, self._path, "cells")
            check_within("table", self._letters, StudyError, self._path, "characters")

    def _value(self, stored: str) -> str:
        if self._kind == "s":
            return self._shared[int(stored)]
        if self._kind == "n" and stored:
            return f"{float(stored):.15g}"  # Excel's own digits: 0.1 is 0.10000000000000001
        return stored


def _column(letters: str) -> int:
    number = 0
    for letter in letters:
        number = 26 * number + ord(letter) - ord("A") + 1
    return number - 1
