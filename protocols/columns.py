"""A column of a tidy table: name, type, unit and meaning, for table and data dictionary alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

ColumnKind = Literal["text", "number", "share", "integer", "0/1", "value"]


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str
    kind: ColumnKind
    """`value`: a number where all are numbers, else text."""
    unit: str
    meaning: str
