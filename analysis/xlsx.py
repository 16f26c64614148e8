"""The first sheet of an .xlsx file as rows of text.

Office Open XML (ECMA-376, part 1, 18.3 sheets and 18.4 shared strings), as far as values go:
formulas give the value that was stored with them, dates their number, styles nothing.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from protocols.errors import StudyError
from protocols.limits import UNPACKED
from protocols.outside import LIMITS_VARIABLE, limit, reading

ENDING = ".xlsx"
_MAIN = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"
_LINK = "{http://schemas.openxmlformats.org/officeDocument/2006/relationships}id"
_PLACE = re.compile(r"([A-Z]{1,3})(\d{1,7})")
_MOST_COLUMNS = 16_384


def read_xlsx(path: Path, notes: list[str]) -> list[list[str]]:
    """Return the rows of the first sheet; blank rows are empty lists.

    `notes` is told where there are more sheets.

    Raises
    ------
    StudyError
        If it is no such file, or unpacks to more than the limit.
    """
    with reading(path, "an .xlsx file", StudyError), zipfile.ZipFile(path) as packed:
        size = sum(entry.file_size for entry in packed.infolist())
        most = limit("unpacked", UNPACKED, StudyError)
        if size > most:
            raise StudyError(
                f"{path}: must unpack to at most {most:,} bytes (it holds"
                f" more); if it is right, raise the limit with {LIMITS_VARIABLE}=unpacked=NUMBER"
            )
        names = set(packed.namelist())
        sheets = list(_part(packed, "xl/workbook.xml").iter(f"{_MAIN}sheet"))
        links = {
            entry.get("Id"): entry.get("Target", "")
            for entry in _part(packed, "xl/_rels/workbook.xml.rels")
        }
        if not sheets:
            raise StudyError(f"{path}: must have a sheet (has none)")
        target = links[sheets[0].get(_LINK)]
        shared: list[str] = []
        if "xl/sharedStrings.xml" in names:
            strings = _part(packed, "xl/sharedStrings.xml")
            shared = [_text(entry) for entry in strings.iter(f"{_MAIN}si")]
        place = target.lstrip("/") if target.startswith("/") else f"xl/{target}"
        rows = list(_rows(path, _part(packed, place), shared))
    if len(sheets) > 1:
        notes.append(f"the first of {len(sheets)} sheets was read: {sheets[0].get('name', '')}")
    return rows


def _part(packed: zipfile.ZipFile, name: str) -> ElementTree.Element:
    data = packed.read(name)
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise ValueError(f"{name} declares entities")
    return ElementTree.fromstring(data)


def _rows(path: Path, sheet: ElementTree.Element, shared: list[str]) -> Iterator[list[str]]:
    number, width = 0, 0
    for row in sheet.iter(f"{_MAIN}row"):
        wanted = int(row.get("r", number + 1))
        if not number < wanted <= 1_048_576:
            raise StudyError(f"{path}: rows must be numbered upwards (got {wanted})")
        yield from ([] for _ in range(wanted - number - 1))
        number = wanted
        cells: list[str] = []
        for cell in row.iter(f"{_MAIN}c"):
            found = _PLACE.fullmatch(cell.get("r", ""))
            column = len(cells) if found is None else _column(found[1])
            if column >= _MOST_COLUMNS:
                raise StudyError(f"{path}: row {number}: has too many columns")
            cells += [""] * (column + 1 - len(cells))
            cells[column] = _value(cell, shared)
        filled = next((k for k in range(len(cells), 0, -1) if cells[k - 1].strip()), 0)
        width = width or filled  # the header says how wide the table is
        yield cells[: max(filled, width)] + [""] * (width - len(cells)) if filled else []


def _column(letters: str) -> int:
    number = 0
    for letter in letters:
        number = 26 * number + ord(letter) - ord("A") + 1
    return number - 1


def _value(cell: ElementTree.Element, shared: list[str]) -> str:
    kind = cell.get("t", "n")
    if kind == "inlineStr":
        return _text(cell)
    stored = cell.findtext(f"{_MAIN}v", "")
    if kind == "s":
        return shared[int(stored)]
    if kind == "n" and stored:
        return f"{float(stored):.15g}"  # Excel's own digits: 0.1 is stored as 0.10000000000000001
    return stored


def _text(entry: ElementTree.Element) -> str:
    """Return a text of plain or rich runs, without how it is pronounced."""
    parts = []
    for child in entry:
        if child.tag == f"{_MAIN}t":
            parts.append(child.text or "")
        elif child.tag in (f"{_MAIN}r", f"{_MAIN}is"):
            parts.append(_text(child))
    return "".join(parts)
