"""The rules of Psych-DS, checked on a folder.

Written from the published schema (https://psychds-docs.readthedocs.io, rules and conventions):
each rule below carries the code that the Psych-DS validator gives it.
"""

import csv
import io
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

DESCRIPTION = "dataset_description.json"
_SCHEMA_ORG = re.compile(r"https?://schema\.org/?")
_DATA_NAME = re.compile(r"([a-z]+-[a-zA-Z0-9]+)(_[a-z]+-[a-zA-Z0-9]+)*_data\.csv")
_REQUIRED = ("name", "description", "variableMeasured")
_NOT_READ = object()


@dataclass(frozen=True)
class Broken:
    """A rule that is not kept."""

    code: str
    file: str
    reason: str

    def __str__(self) -> str:
        return f"{self.file}: {self.code}: {self.reason}"


def broken_rules(folder: Path) -> list[Broken]:
    """Return every rule of Psych-DS that a data set breaks; empty where it is valid."""
    return list(_rules(folder))


def _rules(folder: Path) -> Iterator[Broken]:
    found: list[Broken] = []
    overall = _metadata(folder, folder / DESCRIPTION, found)
    if not (folder / DESCRIPTION).is_file():
        yield Broken("MISSING_DATASET_DESCRIPTION", DESCRIPTION, "must exist")
    data = folder / "data"
    if not data.is_dir():
        yield Broken("MISSING_DATA_DIRECTORY", "data", "must be a folder")
    tables = sorted(data.rglob("*.csv")) if data.is_dir() else []
    named = [path for path in tables if path.name.endswith("_data.csv")]
    valid = [path for path in named if _DATA_NAME.fullmatch(path.name)]
    for path in named:
        if path not in valid:
            yield Broken(
                "FILENAME_KEYWORD_FORMATTING_ERROR",
                _name(folder, path),
                "must be KEY-VALUE pairs joined by '_', then '_data.csv'; keys in a-z, values"
                " letters and digits",
            )
    if data.is_dir() and not valid:
        yield Broken("MISSING_DATAFILE", "data", "must hold a KEY-VALUE_data.csv")
    yield from found
    for path in valid:
        found = []
        merged: dict[str, object] = dict(overall) if isinstance(overall, dict) else {}
        for extra in _inherited(data, path):
            below = _metadata(folder, extra, found)
            if isinstance(below, dict):
                merged |= below
        yield from found
        if isinstance(overall, dict):
            yield from _described(_name(folder, path), merged)
        yield from _table(folder, path, merged)


def _inherited(data: Path, table: Path) -> list[Path]:
    """Return the metadata files that apply to a table below the overall one, general first."""
    parents = [parent for parent in table.parents if parent == data or data in parent.parents]
    files = [parent / "directory_metadata.json" for parent in reversed(parents)]
    return [path for path in (*files, table.with_suffix(".json")) if path.is_file()]


def _metadata(folder: Path, path: Path, found: list[Broken]) -> object:
    if not path.is_file():
        return _NOT_READ
    try:
        content: object = json.loads(path.read_bytes().decode("utf-8"))
    except UnicodeDecodeError:
        found.append(Broken("INVALID_JSON_ENCODING", _name(folder, path), "must be UTF-8"))
    except (ValueError, RecursionError) as error:  # JSON that is none, or whose brackets lie deep
        found.append(Broken("INVALID_JSON_FORMATTING", _name(folder, path), str(error)))
    else:
        if isinstance(content, dict):
            return content
        found.append(Broken("INVALID_JSONLD_FORMATTING", _name(folder, path), "must be one object"))
    return _NOT_READ


def _described(table: str, merged: dict[str, object]) -> Iterator[Broken]:
    """Check what the metadata that apply to a table say together."""
    context = merged.get("@context")
    spaced = isinstance(context, str) and bool(_SCHEMA_ORG.fullmatch(context))

    def term(name: str) -> object:
        full = next((merged[key] for key in merged if _is_term(key, name)), None)
        return merged.get(name) if spaced and full is None else full

    for name in _REQUIRED:
        if not term(name):
            yield Broken(
                "JSON_KEY_REQUIRED", table, f"its metadata must have schema.org's {name!r}"
            )
    kind = merged.get("@type", merged.get("type"))
    if kind is None:
        yield Broken("MISSING_DATASET_TYPE", table, "its metadata must have '@type'")
    elif not ((kind == "Dataset" and spaced) or _is_term(str(kind), "Dataset")):
        yield Broken("INCORRECT_DATASET_TYPE", table, f"'@type' must be 'Dataset' (got {kind!r})")


def _is_term(key: str, name: str) -> bool:
    space, _, last = key.rpartition("/")
    return last == name and bool(_SCHEMA_ORG.fullmatch(space))


def _table(folder: Path, path: Path, merged: dict[str, object]) -> Iterator[Broken]:
    name = _name(folder, path)
    try:
        text = path.read_bytes().decode("utf-8")
    except UnicodeDecodeError:
        yield Broken("CSV_FORMATTING_ERROR", name, "must be UTF-8")
        return
    if not text.strip():
        yield Broken("EMPTY_FILE", name, "must hold a header")
        return
    try:
        header, *rows = list(csv.reader(io.StringIO(text, newline=""), strict=True))
    except csv.Error as error:
        yield Broken("CSV_FORMATTING_ERROR", name, str(error))
        return
    if not any(header):
        yield Broken("CSV_HEADER_MISSING", name, "its first row must name the columns")
        return
    if len(set(header)) < len(header):
        yield Broken("CSV_HEADER_REPEATED", name, "no two columns may have one name")
    uneven = [number for number, row in enumerate(rows, start=2) if len(row) != len(header)]
    if uneven:
        yield Broken(
            "CSV_HEADER_LENGTH_MISMATCH", name, f"row {uneven[0]} must have {len(header)} cells"
        )
    known = _variable_names(merged)
    for column in header:
        if column not in known:
            yield Broken(
                "CSV_COLUMN_MISSING_FROM_METADATA", name, f"{column!r} is not in variableMeasured"
            )
    if "row_id" in header:
        at = header.index("row_id")
        ids = [row[at] for row in rows if len(row) > at]
        if len(set(ids)) < len(ids):
            yield Broken("ROWID_VALUES_NOT_UNIQUE", name, "every row_id must occur once")


def _variable_names(merged: dict[str, object]) -> set[str]:
    measured = next(
        (
            value
            for key, value in merged.items()
            if key == "variableMeasured" or _is_term(key, "variableMeasured")
        ),
        (),
    )
    names = set()
    for entry in measured if isinstance(measured, list) else ():
        if isinstance(entry, str):
            names.add(entry)
        elif isinstance(entry, dict):
            kind = str(entry.get("@type", entry.get("type")))
            if kind == "PropertyValue" or _is_term(kind, "PropertyValue"):
                names.add(str(entry.get("name")))
    return names


def _name(folder: Path, path: Path) -> str:
    return path.relative_to(folder).as_posix()
