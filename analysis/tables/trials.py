"""Trials with right answers of any program, one decided trial per row."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from analysis.tables.table import Source, Table, opened
from analysis.tables.unwanted_rows import leave_out_unanswered
from analysis.tables.words import missing
from protocols.columns import Column, decided
from protocols.errors import StudyError, count_of
from protocols.tasks.confidence_question import COLUMNS, CONFIDENCE
from protocols.tasks.rates import name_of
from protocols.tasks.rating import RATING_COLUMNS
from protocols.tasks.single import ANSWER_COLUMNS

OURS = ("participant", "scene", "order", "expected", "answer", "correct", "rt_s")
_KNOWN = (*OURS, CONFIDENCE)
_SHOWN_VALUES = 12
_ALWAYS = ("session", "participant", "simulated", "trial", "kind", "order", "included", "exclusion")


def read_trials(
    source: Source,
    *,
    conditions: Sequence[str] = (),
    levels: Sequence[str] = (),
    own: bool = True,
    two: bool = False,
) -> pd.DataFrame:
    """Read trials of a yes-no, identification or ABX task from a table of any tool.

    Parameters
    ----------
    source : Table, str or Path
        Needed: ``participant``, and ``correct`` (1/0) or both ``expected`` and ``answer``.
        Optional: ``scene``, ``order``, ``rt_s``, ``confidence``. All other columns are kept, under
        names of one's own if mapped. Of a table with ``kind`` or ``included``, as tidy ones, only
        main trials that are included are read.
    conditions : sequence of str
        Columns that must be there and have a value in every row.
    levels : sequence of str
        Columns that must hold a number in every row.
    own : bool
        Other columns are of use; else they are noted.
    two : bool
        There are two answers: ``expected`` and ``correct`` determine the one given.

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
    table = opened(source)
    table.known((*_KNOWN, *conditions, *levels), own=own)
    _require(table, conditions, levels)
    table.only_main()
    held = [name for name in ("answer", "correct") if name in table.rows]
    held = held if "correct" in held or "expected" in table.rows else []
    shown = set(table.rows["expected"]) if "expected" in table.rows else set()
    leave_out_unanswered(table, held, shown, "trial")
    given = table.rows
    rows = pd.DataFrame(index=given.index)
    for column in ("participant", *(["scene"] if "scene" in given else [])):
        rows[column] = table.take(column)
    for column in [name for name in given.columns if name not in OURS]:
        if column in levels:
            rows[column] = _every_number(table, column)
        elif column in conditions:
            rows[column] = _numeric_if_all(table.text(column))
        elif column == CONFIDENCE:
            rows[column] = confidence_of(table)
        else:
            rows[column] = _numeric_if_all(given[column].str.strip())
    order = table.order(rows["participant"])
    table.refuse(order.isna(), "order must not be empty")
    rows["order"] = order.astype("int64")
    right = table.take("correct")
    if {"expected", "answer"} <= set(given.columns):
        for column in ("expected", "answer"):
            rows[column] = table.text(column)
        _refuse_strangers(table, rows)
        rows["correct"] = (rows["expected"] == rows["answer"]).astype(int)
        if right is not None:
            table.refuse(
                right != rows["correct"],
                lambda at: (
                    "correct must agree with expected and answer"
                    f" (got {right[at]} for expected {given.loc[at, 'expected']!r},"
                    f" answer {given.loc[at, 'answer']!r}); leave one of them out"
                ),
            )
    else:
        assert right is not None
        rows["correct"] = right
        if two and (one := [name for name in ("expected", "answer") if name in given]):
            _other_answer(table, rows, one[0])
    rows["rt_s"] = table.take("rt_s", np.nan)
    return rows.reset_index(drop=True)


def read_times(source: Source, *, by: str | None = None) -> pd.DataFrame:
    """Read reaction times of any task; rows without one are left out and noted.

    Parameters
    ----------
    by : str, optional
        Column of conditions.

    Returns
    -------
    DataFrame
        ``participant``, ``rt_s`` (seconds), ``order``; ``scene`` and `by` as text if given;
        ``expected`` and ``answer`` as `read_trials` returns them and ``correct`` (0/1), where the
        table says which answers were right; ``simulated`` and ``remote`` (0/1), if given.

    Raises
    ------
    StudyError
        With the column, line and value at fault, and the cure.
    """
    table = opened(source)
    conditions = () if by is None else (by,)
    table.known((*OURS, *conditions), own=False)
    table.need([name for name in ("rt_s", *conditions) if name not in table.rows])
    table.only_main()
    judged = "correct" in table.rows or {"expected", "answer"} <= set(table.rows)
    leave_out_unanswered(
        table, ("rt_s", *(["correct"] if "correct" in table.rows else [])), each=True
    )
    kept = ["participant", "scene", *conditions, "order", "rt_s", "simulated", "remote"]
    if judged:
        rows = read_trials(table, conditions=conditions, own=False)
        kept += ["expected", "answer", "correct"]
    else:
        rows = pd.DataFrame({name: table.take(name) for name in ("participant", "rt_s")})
        rows["order"] = table.order(rows["participant"])
        for column in {"scene", *conditions} & set(table.rows):
            rows[column] = table.text(column)
        for column in {"simulated", "remote"} & set(table.rows):
            rows[column] = _numeric_if_all(table.rows[column])
    for column in conditions:
        rows[column] = rows[column].map(name_of)
    return rows[[name for name in dict.fromkeys(kept) if name in rows]].reset_index(drop=True)


def _require(table: Table, conditions: Sequence[str], levels: Sequence[str]) -> None:
    lacking = [name for name in (*conditions, *levels) if name not in table.rows]
    if "correct" not in table.rows:
        have = [name for name in ("expected", "answer") if name in table.rows]
        if not have:
            lacking.append("correct (or expected, answer)")
        lacking += [name for name in ("expected", "answer") if have and name not in have]
    table.need(lacking)


def _numeric_if_all(values: pd.Series) -> pd.Series:
    """Return numbers where every value is a finite one, else the texts."""
    numbers = pd.to_numeric(values, errors="coerce")
    return numbers if bool(np.isfinite(numbers.astype(float)).all()) else values


def confidence_of(table: Table) -> pd.Series:
    """Return confidence as numbers, NaN where it is missing; as texts where it holds words."""
    given = table.rows[CONFIDENCE].str.strip()
    return _numeric_if_all(given[~missing(given)]).reindex(given.index)


def _every_number(table: Table, column: str) -> pd.Series:
    values = table.number(column)
    cure = f"; leave such rows out with {table.cure('--where')} '{column}!=none'"
    table.refuse(
        values.isna(),
        lambda at: f"{column} must not be empty (got {table.rows[column][at]!r}){cure}",
    )
    return values


def _refuse_strangers(table: Table, rows: pd.DataFrame) -> None:
    """Refuse answers that `expected` writes otherwise: each would count as wrong."""
    expected, given = (sorted(rows[name].unique()) for name in ("expected", "answer"))
    both = sorted({*expected, *given})
    alike = [one for one in both if sum(one.casefold() == each.casefold() for each in both) > 1]
    if alike:
        names = {one: e for one in given for e in expected if one.casefold() == e.casefold()}
        turn = ",".join(f"{one}={name}" for one, name in names.items() if one not in expected)
        cure = f"; {table.cure('--answer')} {turn}" if turn else ""
        raise StudyError(
            f"{table.path}: expected and answer must write an answer in one way (found"
            f" {alike[:_SHOWN_VALUES]}){cure}"
        )
    strange = [one for one in given if one not in expected]
    if len(strange) == len(given) and len(expected) > 1:
        cure = ",".join(f"{one}=..." for one in given[:2])
        raise StudyError(
            f"{table.path}: expected and answer must speak of the same answers (expected holds"
            f" {', '.join(expected[:_SHOWN_VALUES])}; answer {', '.join(given[:_SHOWN_VALUES])}:"
            f" none would be right); say which is which: {table.cure('--answer')} {cure}"
        )
    if strange and len(expected) > 1:
        count = count_of(int(rows["answer"].isin(strange).sum()), "row")
        table.notes.append(
            f"answer holds {', '.join(strange[:5])} ({count}), which expected never does:"
            " they count as wrong"
        )


def _other_answer(table: Table, rows: pd.DataFrame, name: str) -> None:
    """Add the column that follows from another and from whether the answer was right."""
    values = table.text(name)
    both = sorted(values.unique())
    if len(both) != 2:
        return
    other = values.map({both[0]: both[1], both[1]: both[0]})
    rows[name] = values
    derived = "answer" if name == "expected" else "expected"
    rows[derived] = values.where(rows["correct"] == 1, other)
    table.notes.append(f"no column {derived}: it follows from {name} and correct")


def as_decisions(rows: pd.DataFrame) -> pd.DataFrame:
    """Return rows of a table that was read with what tidy decisions have beside."""
    count = len(rows)
    defaults = pd.DataFrame(
        {
            "session": rows["participant"],
            "simulated": 0,
            "trial": [f"row-{number}" for number in range(1, count + 1)],
            "kind": "main",
            "included": 1,
            "exclusion": "",
        }
    )
    rows = rows.join(defaults[[name for name in defaults if name not in rows]])
    return rows[[column.name for column in answer_columns(rows)]]


def answer_columns(decisions: pd.DataFrame) -> tuple[Column, ...]:
    """Return the columns of a table that was read: ours first, those of its conditions between."""
    answer = (*RATING_COLUMNS, *ANSWER_COLUMNS)
    known = {column.name for column in decided((), answer)}
    given = {column.name: column for column in given_columns()}
    given["scene"] = Column("scene", "text", "", "Scene")
    condition = tuple(
        given.get(name, Column(name, "value", "", "Column of the table's conditions"))
        for name in map(str, decisions.columns)
        if name not in known
    )
    return tuple(
        column
        for column in decided(condition, answer)
        if column.name in decisions or column.name in _ALWAYS
    )


def given_columns() -> tuple[Column, ...]:
    """Return the columns of confidence as tables of other programs give it: numbers or words."""
    return tuple(replace(column, kind="value") for column in COLUMNS)
