"""Pictures and videos made elsewhere, with a table of their conditions: the recipe `files`."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import TypeAdapter, ValidationError, model_validator

from protocols.blocks import Block
from protocols.disk.whole_file import read_bytes, written_text
from protocols.display import Display
from protocols.errors import Problem, StudyError, did_you_mean
from protocols.limits import check_cells, check_within
from protocols.recipes.base import SCENE, Recipe, Stimulus
from protocols.units import (
    DEVICE,
    NAME_IN_WORDS,
    NAME_LENGTH,
    Hertz,
    Model,
    Name,
    Pixels,
    Scalar,
    Seconds,
    Text,
)

COLUMNS = ("stimulus", "file")
"""Columns that the table must have; every other column is one of the condition."""
_FIRST_LINE = 2  # of the rows: the header is before it
_TOLD = 3
"""Number of missing files that are named one by one."""
_NAME: TypeAdapter[str] = TypeAdapter(Name)


class FileEntry(Model):
    """One picture, video, or folder of frames."""

    name: Name
    """Its name in plans, journals and tables."""
    file: Text
    """Path relative to the study file."""
    condition: dict[Name, Scalar]
    """Condition shown, column by column."""


class Files(Recipe):
    """Pictures or videos made elsewhere, shown pixel by pixel."""

    kind: Literal["files"]
    table: Text | None = None
    """CSV file beside the study file, with columns `stimulus` (a name), `file`, and one per
    condition, such as `scene` and `method`. Default: use `entries`."""
    entries: tuple[FileEntry, ...] = ()
    """The rows of the table, if there is no file."""
    width_px: Pixels
    """Width of every picture. Pictures are never rescaled."""
    height_px: Pixels
    """Height of every picture."""
    fps: Hertz | None = None
    """Frame rate of every video. Leave it out for stills."""
    duration_s: Seconds | None = None
    """Length of every video. Leave it out for stills."""

    @model_validator(mode="after")
    def _one_way_to_say_it(self) -> Files:
        if (self.fps is None) != (self.duration_s is None):
            raise ValueError("fps and duration_s are given together, for videos, or not at all")
        if self.table is None and not self.entries:
            raise ValueError("table must name a CSV file, or entries must list the stimuli")
        for what, values in (
            ("name", [entry.name for entry in self.entries]),
            ("file", [entry.file for entry in self.entries]),
        ):
            for value, count in Counter(values).items():
                if count > 1:
                    raise ValueError(f"every {what} must be given once (got {value!r} {count}x)")
        columns = [set(entry.condition) for entry in self.entries]
        if any(names != columns[0] for names in columns):
            raise ValueError("every entry must have the same columns in its condition")
        return self

    def resolved(self, folder: Path) -> Files:
        """Return the recipe with the rows of its table.

        Raises
        ------
        StudyError
            If the table cannot be read, or lacks a column or a value.
        """
        if self.table is None or self.entries:
            return self
        rows = read_table(folder / self.table)
        plain = self.model_dump() | {"entries": tuple(rows)}
        return Files.model_validate(plain)

    def pool(self) -> tuple[Stimulus, ...]:
        """Return every entry in the order of the table."""
        return tuple(Stimulus(entry.name, entry.condition) for entry in self.entries)

    def described(self, display: Display, scenes: Sequence[str]) -> tuple[Block, ...]:
        """Return blocks on the files, and their conditions."""
        what = "pictures" if self.frames == 1 else f"videos of {self.duration_s:g} s"
        values = [
            f"{column}: " + ", ".join(str(value) for value in self.values(column))
            for column in self.columns()
            if column != SCENE
        ]
        named = ", ".join(scene for scene in scenes if scene)
        return (
            f"{len(self.entries)} {what}, made elsewhere, {self.width_px} x {self.height_px} px,"
            f" never rescaled, on {display.name}: {display.description or 'no description'}.",
            *([f"Scenes: {named}."] if named else []),
            values,
        )

    def size_px(self, _display: Display) -> tuple[int, int]:
        """Return (width, height) of every picture."""
        return self.width_px, self.height_px

    @property
    def frame_hz(self) -> float:
        """Frames per second; 1 for stills."""
        return self.fps or 1.0

    @property
    def frames(self) -> int:
        """Frames of every video; 1 for stills."""
        return 1 if self.duration_s is None else max(1, round(self.duration_s * self.frame_hz))

    def place(self, index: int, key: str) -> str:
        """Return the place where an entry's key was written: in the table or in the study."""
        if self.table is None:
            return f"stimuli.entries[{index}].{key}"
        column = "stimulus" if key == "name" else key
        return f"{self.table}: line {index + _FIRST_LINE}: {column}"

    def problems(self, folder: Path) -> list[Problem]:
        """Return a problem for every file that is not below `folder`."""
        missing = [
            (index, entry)
            for index, entry in enumerate(self.entries)
            if not (folder / entry.file).exists()
        ]
        found = [
            Problem(
                self.place(index, "file"),
                f"the file of {entry.name!r} is not there (looked for {folder / entry.file});"
                " 'metamerlab stimuli build' needs it",
            )
            for index, entry in missing[:_TOLD]
        ]
        if len(missing) > _TOLD:
            found.append(Problem("stimuli", f"{len(missing) - _TOLD} more files are not there"))
        return found


def read_table(path: Path) -> list[dict[str, object]]:
    """Read a table of stimuli.

    A column in which every value is a number holds numbers.

    Returns
    -------
    list of dict
        `name`, `file` and `condition` of each row.

    Raises
    ------
    StudyError
        If the file cannot be read, lacks a column, or a row lacks a value or has a bad name.
    """
    text = written_text(read_bytes(path, "the table of stimuli", "table"), path)
    check_cells(path, text)
    check_within("files", text.count("\n"), StudyError, path, "lines")
    reader = csv.DictReader(io.StringIO(text), strict=True)
    try:
        header = [name.strip() for name in reader.fieldnames or ()]
        reader.fieldnames = header
        rows = list(reader)
    except csv.Error as error:
        raise StudyError(f"{path}: line {reader.line_num}: must be valid CSV ({error})") from None
    separator = next((mark for mark in ";\t" if mark in "".join(header)), None)
    if separator is not None and len(header) == 1:
        raise StudyError(
            f"{path}: line 1: columns must be separated by commas (got {separator!r} between them);"
            " save the table as CSV with commas, and decimals with a point"
        )
    for column in COLUMNS:
        if column not in header:
            raise StudyError(
                f"{path}: line 1: must have a column {column!r} (got {', '.join(header) or 'none'})"
                f"{did_you_mean(column, header)}"
            )
    for name, count in Counter(header).items():
        if count > 1:
            raise StudyError(f"{path}: line 1: every column must come once (got {name!r} {count}x)")
    if not rows:
        raise StudyError(f"{path}: must list at least one stimulus (it has only a header)")
    columns = [name for name in header if name not in COLUMNS]
    for column in columns:
        _check_name(column, f"{path}: line 1: every column's name")
    seen: dict[tuple[str, str], int] = {}
    texts: list[dict[str, str]] = []
    for number, row in enumerate(rows, start=_FIRST_LINE):
        _check_row(path, number, row, header)
        texts.append({column: str(row[column]).strip() for column in header})
        _check_once(path, number, texts[-1], seen)
    values = {column: _numbers([row[column] for row in texts]) for column in columns}
    return [
        {
            "name": row["stimulus"],
            "file": row["file"],
            "condition": {column: values[column][place] for column in columns},
        }
        for place, row in enumerate(texts)
    ]


def _check_row(
    path: Path, number: int, row: dict[str | None, str | list[str] | None], header: list[str]
) -> None:
    if None in row:
        raise StudyError(f"{path}: line {number}: must have {len(header)} values (got more)")
    for column in header:
        value = row[column]
        if not isinstance(value, str) or not value.strip():
            raise StudyError(f"{path}: line {number}: column {column!r} must not be empty")
    name, what = str(row["stimulus"]).strip(), f"{path}: line {number}: stimulus"
    _check_name(name, what)
    if DEVICE.fullmatch(name):
        raise StudyError(
            f"{what} must not be a name that Windows keeps for a device (got {name!r}), as a folder"
            " is called so; choose another"
        )


def _check_once(
    path: Path, number: int, row: dict[str, str], seen: dict[tuple[str, str], int]
) -> None:
    for column in COLUMNS:
        if (before := seen.setdefault((column, row[column]), number)) != number:
            raise StudyError(
                f"{path}: line {number}: every {column} must be given once (got {row[column]!r},"
                f" which line {before} has)"
            )


def _check_name(name: str, what: str) -> None:
    try:
        _NAME.validate_python(name)
    except ValidationError:
        raise StudyError(
            f"{what} must be {NAME_IN_WORDS}, at most {NAME_LENGTH} characters (got {name!r})"
        ) from None


def _numbers(values: list[str]) -> Sequence[Scalar]:
    """Return the values as numbers, or as they are where one is none."""
    for read in (int, float):
        try:
            found: list[float] = [read(value) for value in values]
        except ValueError:
            continue
        if all(abs(value) < 1e300 for value in found):
            return found
    return values
