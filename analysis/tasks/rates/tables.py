"""Tables of right and wrong answers: read from CSV, and written beside a report."""

from collections.abc import Sequence

import pandas as pd

from analysis.columns import frame_of
from analysis.plans.rates import RatesOptions, by_columns
from analysis.rates import Difference
from analysis.tables.table import Table
from analysis.tables.trials import read_trials
from analysis.tasks.rates.study import RateResults
from protocols.columns import Column, decided
from protocols.tasks.single import ANSWER_COLUMNS

_ALWAYS = ("session", "participant", "simulated", "trial", "kind", "order", "included", "exclusion")


def read_answers(
    table: Table, options: RatesOptions, *, own: bool = True, two: bool = False
) -> pd.DataFrame:
    """Read trials of any tool as decisions; `own` and `two` as `read_trials` takes them.

    Returns
    -------
    DataFrame
        As `analysis.tables.trials.read_trials`, and what tidy decisions have beside.

    Raises
    ------
    StudyError
        With the column, line and value at fault.
    """
    wanted = list(by_columns(options.by))
    levels = [name for name in (options.level,) if name is not None]
    rows = read_trials(table, conditions=wanted, levels=levels, own=own, two=two)
    # What was mapped is there under our name; it need not be there twice.
    rows = rows.drop(columns=table.renamed - {*wanted, options.level}, errors="ignore")
    return as_decisions(rows)


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
    ours = decided((), ANSWER_COLUMNS)
    known = {column.name for column in ours}
    condition = tuple(
        Column(str(name), "value", "", "Column of the table's conditions")
        for name in decisions.columns
        if name not in known
    )
    return tuple(
        column
        for column in decided(condition, ANSWER_COLUMNS)
        if column.name in decisions or column.name in _ALWAYS
    )


def result_tables(results: RateResults) -> dict[str, pd.DataFrame]:
    """Return rates, comparisons, counts by level and thresholds, by file name."""
    tables = {
        "rates.csv": _frame(results.rates),
        "comparisons.csv": frame_of(Difference, results.comparisons),
    }
    if results.counts:
        tables["levels.csv"] = pd.DataFrame(
            [
                {"condition": name, "level": x, "right": right, "trials": trials}
                for name, one in results.counts.items()
                for x, right, trials in zip(one.levels, one.right, one.trials, strict=True)
            ]
        )
    if results.thresholds is not None:
        tables["thresholds.csv"] = pd.DataFrame(
            [
                {
                    "condition": one.condition,
                    "participant": who,
                    "threshold": value,
                    "lower": lower,
                    "upper": upper,
                }
                for one in results.thresholds.thresholds
                for who, value, lower, upper in (
                    ("", one.value, one.lower, one.upper),
                    *((name, own, None, None) for name, own in one.individual.items()),
                )
            ]
        )
    return tables


def _frame(found: Sequence[object]) -> pd.DataFrame:
    return pd.DataFrame(
        [
            {k: "; ".join(v) if isinstance(v, tuple) else v for k, v in vars(one).items()}
            for one in found
        ]
    )
