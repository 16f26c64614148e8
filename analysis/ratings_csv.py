"""Ordered ratings from other tools: a plain CSV, one rating of a condition or of a pair per row."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from analysis.csv_table import (
    need_columns,
    read_table,
    refuse_equals,
    refuse_rows,
    renamed,
    seconds_column,
    shortened,
    text_column,
)
from analysis.trials_csv import analysed_rows
from protocols.errors import StudyError
from protocols.suggest import did_you_mean


def read_ratings(
    path: Path,
    mapping: Mapping[str, str] | None = None,
    *,
    by: str | None = None,
    scale: Sequence[str] = (),
    option: str = "--{} ",
) -> pd.DataFrame:
    """Read ratings from a CSV file of any tool.

    Parameters
    ----------
    path : Path
        CSV with ``participant`` and ``rating``; ``scene`` and ``rt_s`` (seconds) if there are.
        Graded comparisons of pairs have ``first`` and ``second`` in place of `by`; their rating
        is the larger the more the first is better, 0 for a tie. Of a table with ``kind`` or
        ``included`` only main trials that are included are read.
    by : str, optional
        The column of conditions; left out: the ratings are of pairs.
    scale : sequence of str
        Ratings from the lowest, where they are no numbers.
    option : str
        How `by` and `scale` are named in messages.

    Returns
    -------
    DataFrame
        ``participant``, ``scene`` (if given), `by` or ``first`` and ``second``, ``rating`` (text
        with a scale, else a number), ``order``, ``rt_s`` (NaN where not given), ``simulated``
        (0/1).

    Raises
    ------
    StudyError
        With the column, line and value at fault, and the cure.
    """
    table = analysed_rows(path, renamed(path, read_table(path), mapping or {}, None))
    named = ("first", "second") if by is None else (by,)
    wanted = ("participant", "rating", *named)
    missing = [name for name in wanted if name not in table]
    cure = f" (or name the column of conditions with {option.format('by')}COLUMN)"
    need_columns(path, table, missing, cure if by is None else "")
    if by is None and scale:
        raise StudyError(
            f"{option.format('scale').strip()} must be left out for pairs: their ratings are"
            " numbers around 0"
        )
    if table.empty:
        raise StudyError(f"{path}: must hold at least one rating (the table has no rows)")
    scene = ("scene",) if "scene" in table else ()
    rows = pd.DataFrame(
        {name: text_column(path, table, name) for name in ("participant", *scene, *named)},
        index=table.index,
    )
    rows["rating"] = text_column(path, table, "rating")
    _check_ratings(path, rows["rating"], scale, option)
    if by is None:
        refuse_equals(path, rows)
    if not scale:
        rows["rating"] = pd.to_numeric(rows["rating"])
    rows["order"] = rows.groupby("participant").cumcount() + 1
    rows["rt_s"] = seconds_column(path, table, "rt_s") if "rt_s" in table else np.nan
    rows["simulated"] = (table["simulated"] == "1").astype(int) if "simulated" in table else 0
    return rows.reset_index(drop=True)


def _check_ratings(path: Path, ratings: pd.Series, scale: Sequence[str], option: str) -> None:
    numbers = pd.to_numeric(ratings, errors="coerce").astype(float)
    known = ratings.isin(list(scale)) if scale else pd.Series(np.isfinite(numbers), ratings.index)
    must = (
        f"one of {', '.join(scale)}"
        if scale
        else "a number, or the ratings be named from the lowest on with"
        f" {option.format('scale')}bad,fair,good"
    )

    def said(at: int) -> str:
        got = shortened(ratings[at])
        hint = did_you_mean(got, list(scale)) if scale else ""
        return f"rating must be {must} (got {got!r}){hint}"

    refuse_rows(path, ~known, said)


def scale_of(text: str | None, option: str = "--scale") -> tuple[str, ...]:
    """Return ratings from a text with commas between, from the lowest; none of None.

    Raises
    ------
    StudyError
        If fewer than two are named, or one twice.
    """
    if text is None:
        return ()
    names = tuple(name.strip() for name in text.split(","))
    if len(names) < 2 or "" in names or len(set(names)) < len(names):
        raise StudyError(
            f"{option} must name two different ratings or more, from the lowest on, with commas"
            f" between (got {text!r})"
        )
    return names
