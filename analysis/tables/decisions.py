"""Preferences of any program: one decision between two methods per row."""

import numpy as np
import pandas as pd

from analysis.data_dictionary import frame
from analysis.models.contrasts import check_conditions
from analysis.tables.table import Source, Table, opened
from analysis.tables.trials import confidence_of, given_columns
from analysis.tables.unwanted_rows import leave_out_unanswered
from analysis.tables.words import CHOSE_FIRST, CHOSE_SECOND, FIRST, SECOND, TIES, among, missing
from protocols.columns import Column, decided
from protocols.tasks.confidence_question import CONFIDENCE
from protocols.tasks.pairs import CHOICE_COLUMNS, PAIR_COLUMNS, SCENE_COLUMNS

PREFERENCE_COLUMNS = decided((*SCENE_COLUMNS, *PAIR_COLUMNS), CHOICE_COLUMNS)
"""Columns of a table of preferences that no protocol belongs to."""
PAIR = ("first", "second")
KNOWN = (
    *("participant", *PAIR),
    *("chosen", "chose_first", "scene", "size", "session", "order", "repeat", "rt_s"),
    *("chosen_side", "kind", CONFIDENCE),
)
NO_SIZE = "all"
KINDS = ("main", "practice", "catch")


def read_decisions(source: Source) -> pd.DataFrame:
    """Read one decision per row from a table of any tool.

    Parameters
    ----------
    source : Table, str or Path
        Needed: ``participant``, ``first`` and ``second`` (the methods compared), and
        ``chosen`` (the method's name, or its place) or ``chose_first`` (1/0). Optional: ``scene``,
        ``size``, ``order``, ``repeat``, ``rt_s``, ``chosen_side``, ``session``, ``confidence``.

    Raises
    ------
    StudyError
        With the column, row and value at fault.
    """
    table = opened(source)
    table.known(KNOWN)
    lacking = [column for column in PAIR if column not in table.rows]
    answers = [column for column in ("chosen", "chose_first") if column in table.rows]
    table.need([*lacking, *([] if answers else ["chosen (or chose_first)"])])
    check_conditions(len({*table.rows["first"], *table.rows["second"]}))
    leave_out_unanswered(table, answers, {*table.rows["first"], *table.rows["second"]}, "decision")
    given = table.rows
    rows = pd.DataFrame(
        {name: table.take(name) for name in ("participant", *PAIR)}, index=given.index
    )
    refuse_equals(table, rows)
    rows["chose_first"] = _choices(table, rows)
    chose = rows["chose_first"] == 1
    rows["chosen"] = rows["first"].where(chose, rows["second"])
    rows["rejected"] = rows["second"].where(chose, rows["first"])
    defaults = {"scene": "all", "size": NO_SIZE, "session": rows["participant"], "rt_s": np.nan}
    defaults |= {"repeat": None, "simulated": 0, "remote": 0, "included": 1}
    for column, value in defaults.items():
        rows[column] = table.take(column, value)
    sizes = rows["size"] == NO_SIZE
    table.refuse(
        sizes & (not sizes.all()),
        f"a size must not be called {NO_SIZE!r} beside others (it means all sizes together); give"
        " it another name",
    )
    rows["chosen_side"] = given["chosen_side"].str.strip() if "chosen_side" in given else ""
    rows["kind"] = given["kind"].str.strip() if "kind" in given else "main"
    must = f"kind must be one of {', '.join(KINDS)}"
    table.refuse(~rows["kind"].isin(KINDS), must, rows["kind"])
    if CONFIDENCE in given:
        rows[CONFIDENCE] = confidence_of(table)
    rows["order"] = table.order(rows["participant"])
    rows["trial"] = [f"row-{number + 2}" for number in rows.index]
    rows["attempts"] = 1
    rows["exclusion"] = given.get("exclusion", "")
    records: list[dict[str, object]] = [
        {str(key): value for key, value in record.items()} for record in rows.to_dict("records")
    ]
    return frame(records, preference_columns(rows))


def preference_columns(rows: pd.DataFrame) -> tuple[Column, ...]:
    """Return the columns of a table of preferences: ours, and confidence where it is given."""
    given = (column for column in given_columns() if column.name in rows)
    return (*PREFERENCE_COLUMNS, *given)


def refuse_equals(table: Table, rows: pd.DataFrame) -> None:
    """Refuse a comparison of something with itself."""
    table.refuse(
        rows["first"] == rows["second"],
        lambda at: f"first and second must differ (got {rows['first'][at]!r} twice)",
    )


def by_place(table: Table, rows: pd.DataFrame) -> pd.Series:
    """Return the column `chosen`; left and right, or first and second, become names."""
    chosen = table.rows["chosen"].str.strip()
    said = {one.casefold() for one in chosen[~missing(chosen) & ~among(chosen, TIES - {"0"})]}
    named = {one.casefold() for column in ("first", "second") for one in rows[column].unique()}
    if not said or not said <= FIRST | SECOND or said & named:
        return chosen
    theirs = {name: table.theirs(name) for name in ("first", "second", "chosen")}
    table.notes.append(
        f"{theirs['chosen']} says {' and '.join(sorted(said))}: read as the columns"
        f" {theirs['first']} and {theirs['second']}"
    )
    left = among(chosen, FIRST)
    return chosen.mask(left, rows["first"]).mask(among(chosen, SECOND), rows["second"])


def _choices(table: Table, rows: pd.DataFrame) -> pd.Series:
    given, first, both = table.rows, None, pd.Series(True, rows.index)
    if "chose_first" in given:
        raw = given["chose_first"]
        blank = missing(raw) if "chosen" in given else pd.Series(False, rows.index)
        first = among(raw, CHOSE_FIRST)
        known = first | among(raw, CHOSE_SECOND) | blank
        table.refuse(~known, "chose_first must be 1 or 0", raw)
        both = ~blank
    if "chosen" not in given:
        assert first is not None
        return first.astype(int)
    chosen = by_place(table, rows)
    empty = missing(chosen, {*rows["first"].str.casefold(), *rows["second"].str.casefold()})
    if first is not None:
        chosen = chosen.mask(empty & both, rows["first"].where(first, rows["second"]))
    ties = among(chosen, TIES)
    table.refuse(
        (chosen != rows["first"]) & (chosen != rows["second"]),
        lambda at: (
            f"chosen must be {rows.loc[at, 'first']!r} or {rows.loc[at, 'second']!r}"
            f" (got {chosen[at]!r})"
            + (
                "; 'metamerlab analysis ratings' takes ties, of this table as it is"
                if ties[at]
                else ""
            )
        ),
    )
    picked = chosen == rows["first"]
    if first is not None:
        table.refuse(
            (picked != first) & both,
            lambda at: (
                "chosen and chose_first must say the same"
                f" (chosen says {'first' if picked[at] else 'second'}, chose_first"
                f" {'first' if first[at] else 'second'}); leave one of them out"
            ),
        )
    return picked.astype(int)
