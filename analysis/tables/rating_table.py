"""Ordered ratings of any program: one rating of a condition or of a pair per row."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from analysis.tables import column_units
from analysis.tables.decisions import by_place, refuse_equals
from analysis.tables.table import Source, Table, opened
from analysis.tables.table_files import shortened
from analysis.tables.unwanted_rows import leave_out_unanswered
from analysis.tables.words import TIES, among
from protocols.errors import StudyError, did_you_mean


def read_ratings(
    source: Source,
    *,
    by: str | None = None,
    scale: Sequence[str] = (),
    option: str = "--{} ",
) -> pd.DataFrame:
    """Read ratings from a table of any tool.

    Parameters
    ----------
    source : Table, str or Path
        With ``participant`` and ``rating``; ``scene`` and ``rt_s`` (seconds) if there are.
        Graded comparisons of pairs have ``first`` and ``second`` in place of `by`; their rating
        is the larger the more the first is better, 0 for a tie; or ``chosen`` says which is, or
        that it is a tie. Of a table with ``kind`` or ``included`` only main trials that are
        included are read.
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
        and ``remote`` (0/1).

    Raises
    ------
    StudyError
        With the column, line and value at fault, and the cure.
    """
    table = opened(source)
    named = ("first", "second") if by is None else (by,)
    chosen = by is None and "rating" not in table.rows and "chosen" in table.rows
    rated = "chosen" if chosen else "rating"
    wanted = ("participant", rated, *named)
    table.known((*wanted, "scene", "rt_s", "order"))
    cure = f" (or name the column of conditions with {option.format('by')}COLUMN)"
    table.need([name for name in wanted if name not in table.rows], cure if by is None else "")
    if by is None and scale:
        raise StudyError(
            f"{option.format('scale').strip()} must be left out for pairs: their ratings are"
            " numbers around 0"
        )
    table.only_main()
    words = {*table.rows["first"], *table.rows["second"]} if chosen else set(scale)
    leave_out_unanswered(table, [rated], words, "rating")
    given = table.rows
    scene = ("scene",) if "scene" in given else ()
    rows = pd.DataFrame(
        {name: table.text(name) for name in ("participant", *scene, *named)}, index=given.index
    )
    if by is None:
        refuse_equals(table, rows)
    rows["rating"] = _of_choices(table, rows) if chosen else _ratings(table, by, scale, option)
    table.order(rows["participant"])
    rows["order"] = rows.groupby("participant").cumcount() + 1
    rows["rt_s"] = table.take("rt_s", np.nan)
    for column in ("simulated", "remote"):
        rows[column] = (given[column] == "1").astype(int) if column in given else 0
    return rows.reset_index(drop=True)


def _of_choices(table: Table, rows: pd.DataFrame) -> pd.Series:
    """Return 1 where the first was chosen, -1 where the second was, 0 for a tie."""
    chosen = by_place(table, rows)
    first, second, tie = chosen == rows["first"], chosen == rows["second"], among(chosen, TIES)
    table.refuse(~first & ~second & ~tie, "chosen must be one of the pair, or 'tie'", chosen)
    table.notes.append("no column rating: the chosen one counts as 1 better, a tie as 0")
    return first.astype(float) - second.astype(float)


def _ratings(table: Table, by: str | None, scale: Sequence[str], option: str) -> pd.Series:
    ratings = table.text("rating")
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
        option = table.cure(f"--map rating={table.theirs('rating')}")
        hint = did_you_mean(got, list(scale)) if scale else column_units.cure(got, option)
        return f"rating must be {must} (got {got!r}){hint}"

    table.refuse(~known, said)
    if scale:
        return ratings
    table.number("rating", rare=by is not None)
    return pd.to_numeric(ratings)
