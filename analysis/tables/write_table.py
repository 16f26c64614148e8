"""Tables written as CSV that spreadsheets show and do not run (docs/decisions/0165)."""

from functools import lru_cache
from pathlib import Path

import pandas as pd

from protocols.outside import CONTROL, safe_cell


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Write a table as CSV that spreadsheets show and do not run.

    A text that begins with = + - @ or a control character gets an apostrophe in front, as does one
    that begins so after apostrophes; `table_files.rows_of` takes one away again. Other control
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
