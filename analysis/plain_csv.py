"""Decisions from other tools: a plain CSV with its columns mapped to ours."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from analysis.columns import frame
from analysis.csv_table import (
    flag_column,
    need_columns,
    read_table,
    refuse_equals,
    refuse_rows,
    renamed,
    seconds_column,
    text_column,
    whole_column,
)
from protocols.columns import decided
from protocols.errors import StudyError
from protocols.tasks.pairs import CHOICE_COLUMNS, PAIR_COLUMNS, SCENE_COLUMNS

PREFERENCE_COLUMNS = decided((*SCENE_COLUMNS, *PAIR_COLUMNS), CHOICE_COLUMNS)
"""Of a table of preferences that no protocol belongs to."""

REQUIRED = ("participant", "first", "second")
OPTIONAL = (
    "chosen",
    "chose_first",
    "scene",
    "size",
    "session",
    "order",
    "repeat",
    "rt_s",
    "chosen_side",
    "kind",
)
NO_SIZE = "all"
KINDS = ("main", "practice", "catch")

_TRUE = {"1", "1.0", "true", "yes", "first", "a", "left"}
_FALSE = {"0", "0.0", "-1", "-1.0", "2", "false", "no", "second", "b", "right"}


def read_decisions(path: Path, mapping: Mapping[str, str] | None = None) -> pd.DataFrame:
    """Read one decision per row from a CSV file of any tool.

    Parameters
    ----------
    path : Path
        CSV with a header, UTF-8; comma, semicolon or tab.
    mapping : mapping of our name to the file's column, optional
        Needed: ``participant``, ``first`` and ``second`` (the methods compared), and either
        ``chosen`` (the method's name) or ``chose_first`` (1/0). Optional: ``scene``, ``size``,
        ``order``, ``repeat``, ``rt_s``, ``chosen_side``, ``session``. Columns that already have
        our names need no entry.

    Raises
    ------
    StudyError
        With the column, row and value at fault.
    """
    table = read_table(path)
    named = _rename(path, table, mapping or {})
    if named.empty:
        raise StudyError(f"{path}: must hold at least one decision (the table has no rows)")
    rows = pd.DataFrame(index=named.index)
    for column in ("participant", "first", "second"):
        rows[column] = text_column(path, named, column)
    refuse_equals(path, rows)
    rows["chose_first"] = _choices(path, named, rows)
    chose = rows["chose_first"] == 1
    rows["chosen"] = rows["first"].where(chose, rows["second"])
    rows["rejected"] = rows["second"].where(chose, rows["first"])
    rows["scene"] = text_column(path, named, "scene") if "scene" in named else "all"
    rows["size"] = _sizes(path, named) if "size" in named else NO_SIZE
    rows["session"] = (
        text_column(path, named, "session") if "session" in named else rows["participant"]
    )
    rows["chosen_side"] = named["chosen_side"].str.strip() if "chosen_side" in named else ""
    rows["kind"] = _kinds(path, named) if "kind" in named else "main"
    rows["order"] = rows.groupby("participant").cumcount() + 1
    for column in ("order", "repeat"):
        if column in named:
            rows[column] = whole_column(path, named, column)
    if "rt_s" in named:
        rows["rt_s"] = seconds_column(path, named, "rt_s")
    rows["trial"] = [f"row-{number + 2}" for number in rows.index]
    rows["simulated"] = flag_column(path, named, "simulated") if "simulated" in named else 0
    rows["attempts"] = 1
    rows["included"] = flag_column(path, named, "included") if "included" in named else 1
    rows["exclusion"] = named.get("exclusion", "")
    records: list[dict[str, object]] = [
        {str(key): value for key, value in record.items()} for record in rows.to_dict("records")
    ]
    return frame(records, PREFERENCE_COLUMNS)


def _rename(path: Path, table: pd.DataFrame, mapping: Mapping[str, str]) -> pd.DataFrame:
    named = renamed(path, table, mapping, (*REQUIRED, *OPTIONAL))
    missing = [column for column in REQUIRED if column not in named]
    if "chosen" not in named and "chose_first" not in named:
        missing.append("chosen (or chose_first)")
    need_columns(path, named, missing)
    return named


def _choices(path: Path, table: pd.DataFrame, rows: pd.DataFrame) -> pd.Series:
    if "chosen" in table:
        chosen = text_column(path, table, "chosen")
        refuse_rows(
            path,
            (chosen != rows["first"]) & (chosen != rows["second"]),
            lambda at: (
                f"chosen must be {rows.loc[at, 'first']!r} or"
                f" {rows.loc[at, 'second']!r} (got {chosen[at]!r})"
            ),
        )
        picked = (chosen == rows["first"]).astype(int)
        if "chose_first" in table:
            said = table[table["chose_first"].str.strip() != ""]
            _agree(path, picked[said.index], _picked(path, said))
        return picked
    return _picked(path, table)


def _agree(path: Path, chosen: pd.Series, chose_first: pd.Series) -> None:
    refuse_rows(
        path,
        chosen != chose_first,
        lambda at: (
            "chosen and chose_first must say the same"
            f" (chosen says {'first' if chosen[at] else 'second'}, chose_first"
            f" {'first' if chose_first[at] else 'second'}); leave one of them out"
        ),
    )


def _sizes(path: Path, table: pd.DataFrame) -> pd.Series:
    sizes = text_column(path, table, "size")
    named_all = sizes == NO_SIZE
    must = (
        f"a size must not be called {NO_SIZE!r} beside others (it means all sizes together); give"
        " it another name"
    )
    refuse_rows(path, named_all & (not named_all.all()), must)
    return sizes


def _kinds(path: Path, table: pd.DataFrame) -> pd.Series:
    kinds = table["kind"].str.strip()
    refuse_rows(path, ~kinds.isin(KINDS), f"kind must be one of {', '.join(KINDS)}", kinds)
    return kinds


def _picked(path: Path, table: pd.DataFrame) -> pd.Series:
    raw = table["chose_first"].str.strip().str.lower()
    refuse_rows(path, ~raw.isin(_TRUE | _FALSE), "chose_first must be 1 or 0", raw)
    return raw.isin(_TRUE).astype(int)
