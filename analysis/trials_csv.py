"""Trials with right answers from other tools: a plain CSV, one decided trial per row."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from analysis.csv_table import (
    need_columns,
    number_column,
    read_table,
    refuse_rows,
    renamed,
    seconds_column,
    text_column,
    whole_column,
)
from protocols.errors import StudyError
from protocols.suggest import did_you_mean

_RIGHT = {"1", "1.0", "true", "yes", "correct", "right"}
_WRONG = {"0", "0.0", "false", "no", "incorrect", "wrong"}
_SHOWN_VALUES = 12


def read_trials(
    path: Path,
    mapping: Mapping[str, str] | None = None,
    *,
    conditions: Sequence[str] = (),
    levels: Sequence[str] = (),
    answers: Sequence[str] = (),
) -> pd.DataFrame:
    """Read trials of a yes-no, identification or ABX task from a CSV file of any tool.

    Parameters
    ----------
    path : Path
        CSV with a header, UTF-8; comma, semicolon or tab.
    mapping : mapping of our name to the file's column, optional
        Needed: ``participant``, and ``correct`` (1/0) or both ``expected`` and ``answer``.
        Optional: ``scene``, ``order``, ``rt_s``. Columns that already have our names need no
        entry. All other columns are kept, under names of one's own if mapped. Of a table with
        ``kind`` or ``included``, as tidy ones, only main trials that are included are read.
    conditions : sequence of str
        Columns that must be there and have a value in every row.
    levels : sequence of str
        Columns that must hold a number in every row.
    answers : sequence of str
        What ``expected`` and ``answer`` may hold; empty: anything.

    Returns
    -------
    DataFrame
        ``participant``, ``scene`` (if given), the other columns, ``order``, ``expected`` and
        ``answer`` (if given), ``correct`` (0/1), ``rt_s`` (seconds, NaN where not given).
        Without ``order`` the rows of a participant count as being in order.

    Raises
    ------
    StudyError
        With the column, line and value at fault, and the cure.
    """
    table = analysed_rows(path, renamed(path, read_table(path), mapping or {}, None))
    _require(path, table, conditions, levels)
    rows = pd.DataFrame(index=table.index)
    rows["participant"] = text_column(path, table, "participant")
    if "scene" in table:
        rows["scene"] = text_column(path, table, "scene")
    ours = {"participant", "scene", "order", "expected", "answer", "correct", "rt_s"}
    for column in [name for name in table.columns if name not in ours]:
        if column in levels:
            rows[column] = _every_number(path, table, column)
        elif column in conditions:
            rows[column] = _numeric_if_all(text_column(path, table, column))
        else:
            rows[column] = _numeric_if_all(table[column].str.strip())
    if "order" in table:
        rows["order"] = _order(path, table, rows["participant"])
    else:
        rows["order"] = rows.groupby("participant").cumcount() + 1
    right = None
    if "expected" in table and "answer" in table:
        for column in ("expected", "answer"):
            rows[column] = _answers(path, table, column, answers)
        right = (rows["expected"] == rows["answer"]).astype(int)
    rows["correct"] = _correct(path, table, right)
    rows["rt_s"] = seconds_column(path, table, "rt_s") if "rt_s" in table else np.nan
    return rows.reset_index(drop=True)


def analysed_rows(path: Path, table: pd.DataFrame) -> pd.DataFrame:
    """Leave out practice, catch trials and what exclusion rules left out."""
    for column, wanted, known in (
        ("kind", ("main",), ("main", "practice", "catch")),
        ("included", ("1", "1.0"), ("1", "1.0", "0", "0.0")),
    ):
        if column not in table:
            continue
        values = table[column].str.strip()
        named = ", ".join(dict.fromkeys(name.removesuffix(".0") for name in known))
        must = f"{column} must be one of {named}"
        refuse_rows(path, ~values.isin(known), must, values)
        table = table[values.isin(wanted)]
    return table


def _require(
    path: Path, table: pd.DataFrame, conditions: Sequence[str], levels: Sequence[str]
) -> None:
    missing = [name for name in ("participant", *conditions, *levels) if name not in table]
    if "correct" not in table and not {"expected", "answer"} <= set(table.columns):
        have = [name for name in ("expected", "answer") if name in table]
        missing.append(
            ({"expected", "answer"} - set(have)).pop() if have else "correct (or expected, answer)"
        )
    need_columns(path, table, missing)
    if table.empty:
        raise StudyError(f"{path}: must hold at least one trial (the table has no rows)")


def _numeric_if_all(values: pd.Series) -> pd.Series:
    """Return numbers where every value is a finite one, else the texts."""
    numbers = pd.to_numeric(values, errors="coerce")
    return numbers if bool(np.isfinite(numbers.astype(float)).all()) else values


def _every_number(path: Path, table: pd.DataFrame, column: str) -> pd.Series:
    values = number_column(path, table, column)
    refuse_rows(path, values.isna(), f"{column} must not be empty")
    return values.astype(float)


def _order(path: Path, table: pd.DataFrame, people: pd.Series) -> pd.Series:
    _every_number(path, table, "order")
    order = whole_column(path, table, "order").astype("int64")
    refuse_rows(
        path,
        pd.DataFrame({"who": people, "order": order}).duplicated(),
        lambda at: (
            "order must not come twice for a participant"
            f" (got {order[at]} again for {people[at]!r}); leave it out if rows are in order"
        ),
    )
    return order


def _answers(path: Path, table: pd.DataFrame, column: str, answers: Sequence[str]) -> pd.Series:
    values = text_column(path, table, column)
    refuse_rows(
        path,
        ~values.isin(list(answers)) & bool(answers),
        lambda at: (
            f"{column} must be one of {', '.join(answers)}"
            f" (got {values[at]!r}){did_you_mean(values[at], list(answers))}"
        ),
    )
    alike = {value: value.casefold() for value in values.unique()}
    if len(set(alike.values())) < len(alike):
        same = sorted(v for v in alike if list(alike.values()).count(alike[v]) > 1)
        raise StudyError(
            f"{path}: {column} must write an answer in one way (found {same[:_SHOWN_VALUES]})"
        )
    return values


def _correct(path: Path, table: pd.DataFrame, right: pd.Series | None) -> pd.Series:
    if "correct" not in table:
        assert right is not None
        return right
    raw = table["correct"].str.strip().str.lower()
    refuse_rows(path, ~raw.isin(_RIGHT | _WRONG), "correct must be 1 or 0", table["correct"])
    values = raw.isin(_RIGHT).astype(int)
    if right is not None:
        refuse_rows(
            path,
            values != right,
            lambda at: (
                "correct must agree with expected and answer"
                f" (got {values[at]} for expected {table.loc[at, 'expected']!r},"
                f" answer {table.loc[at, 'answer']!r}); leave one of them out"
            ),
        )
    return values
