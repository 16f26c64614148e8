"""Tables in the form that BIDS asks for: tab-separated, `n/a` where nothing is."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from protocols.columns import Column
from protocols.disk.hashing import Json
from protocols.outside import page_bytes

NOTHING = "n/a"


@dataclass(frozen=True)
class FileColumn:
    """A column of a table, as its sidecar explains it."""

    name: str
    description: str
    unit: str = ""
    levels: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(cls, column: Column) -> "FileColumn":
        """Return a column of the tidy tables; units are for numbers, BIDS takes them so."""
        if column.kind == "text":
            return cls(column.name, column.meaning + (f" ({column.unit})" if column.unit else ""))
        return cls(column.name, column.meaning, column.unit)

    def doc(self) -> dict[str, Json]:
        """Return its entry in a sidecar."""
        found: dict[str, Json] = {"Description": self.description}
        if self.unit:
            found["Units"] = self.unit
        if self.levels:
            found["Levels"] = dict(self.levels)
        return found


def column_docs(columns: Sequence[Column]) -> dict[str, Json]:
    """Return the sidecar entries of tidy columns."""
    return {column.name: FileColumn.of(column).doc() for column in columns}


def write_tsv(path: Path, table: pd.DataFrame, columns: Sequence[FileColumn]) -> None:
    """Write those of `columns` that the table has; cells lose tabs and line ends."""
    names = [column.name for column in columns if column.name in table]
    rows = ("\t".join(map(cell, row)) for row in table[names].itertuples(index=False))
    lines = ["\t".join(names), *rows]
    path.write_bytes(page_bytes("\n".join(lines) + "\n"))


def cell(value: object) -> str:
    """Return one cell: `n/a` for what is missing or empty."""
    if value is None or value is pd.NA or value != value:
        return NOTHING
    return " ".join(str(value).split()) or NOTHING
