"""Rows that nobody answered: no answer is never a wrong one."""

from collections.abc import Collection, Sequence

import numpy as np
import pandas as pd

from analysis.tables.table import OURS, Table
from analysis.tables.words import ANSWERED, NO, UNANSWERED, YES, among, ended, means, missing, plain
from protocols.columns import COMMON_COLUMNS
from protocols.errors import StudyError, count_of

_MANY = 5
"""Fewest wrong answers of which a person surely gave some."""
_RUN = 5
"""Fewest times that are one limit; so many below it are looked at."""


def leave_out_unanswered(
    table: Table,
    columns: Sequence[str],
    answers: Collection[str] = (),
    noun: str = "answer",
    *,
    each: bool = False,
) -> None:
    """Leave out rows that nobody answered; no answer is never a wrong one.

    Parameters
    ----------
    columns : sequence of str
        Those that hold the answer; one of them is enough, with `each` none may be missing.
    answers : collection of str
        Words that are answers, though they may mean missing elsewhere.
    noun : str
        What a row is.
    """
    words = {one.strip().casefold() for one in answers}
    rows = table.rows
    blank = [missing(rows[name], words) for name in columns]
    none = pd.Series(False, rows.index)
    if blank:
        together = pd.concat(blank, axis=1)
        none = together.any(axis=1) if each else together.all(axis=1)
    late = pd.Series(False, rows.index)
    right = among(rows["correct"], YES) if "correct" in rows else late
    wrong = among(rows["correct"], NO) if "correct" in rows else late
    for name in map(str, rows.columns):
        timed = means(name, OURS["rt_s"])
        last = plain(name.rpartition(".")[2])
        if last in UNANSWERED | ANSWERED:
            says = YES if last in UNANSWERED else NO
            empty, judged = among(rows[name], says), ~right
        elif timed or means(name, OURS["answer"]):
            empty, judged = missing(rows[name], words), wrong
            if timed:
                empty |= pd.to_numeric(rows[name], errors="coerce") <= 0
                if (name, "<") not in table.bounded:
                    empty |= _at_limit(table, name, right, wrong)
        elif name not in {*columns, *COMMON_COLUMNS} and right.any():
            empty, judged = ended(rows[name]), ~right
            if (empty & right).any():
                continue
        else:
            continue
        # A column that is empty where answers were right does not tell.
        if "correct" in table.filtered:
            continue
        if not (empty & right).any():
            if name not in columns and wrong.sum() >= _MANY and not (wrong & ~empty).any():
                raise StudyError(
                    f"{table.path}: {name} must say of wrong answers, too, when they came (it is"
                    f" empty in all {int(wrong.sum())} rows that count as wrong); if nobody"
                    f" answered these, leave them out with {table.cure('--where')}"
                    f" '{name}!=none', else keep them with --where 'correct!=none'"
                )
            late |= empty & judged
        elif (empty & wrong).any() and 2 * (empty & right).sum() < right.sum():
            table.notes.append(
                f"{name} is empty in {count_of(int((empty & right).sum()), 'row')} of right"
                f" answers: the {int((empty & wrong).sum())} of wrong ones were kept"
            )
    table.leave_out(none | late, " without an answer")
    if table.rows.empty:
        why = "the table has no rows" if rows.empty else table.notes[-1]
        raise StudyError(f"{table.path}: must hold at least one {noun} ({why})")


def _at_limit(table: Table, name: str, right: pd.Series, wrong: pd.Series) -> pd.Series:
    """Return True where a time is the limit, and note it."""
    last = at_limit(table.rows[name], right, wrong)
    if last.any():
        held = table.rows[name][last].iloc[0]
        table.notes.append(
            f"{name} is {held}, the longest, in {count_of(int(last.sum()), 'row')}, all wrong:"
            " taken for the time limit, without an answer; if they are answers, say"
            f" {table.cure('--where')} '{name}<={held}'"
        )
    return last


def at_limit(times: pd.Series, right: pd.Series, wrong: pd.Series) -> pd.Series:
    """Return True where a time is a limit that ran out: the longest, again and again, never right.

    It comes at least five times and more than three times as often as any of the five times below
    it: times thin out towards the longest. That all of these are wrong comes by chance less than
    once in a thousand, at the others' share of wrong answers.
    """
    numbers = pd.to_numeric(times, errors="coerce").astype(float)
    counts = numbers.value_counts().sort_index(ascending=False)
    last = numbers == (counts.index[0] if len(counts) else np.nan)
    often = int(last.sum())
    if len(counts) <= _RUN or often < _RUN or often <= 3 * counts.iloc[1 : _RUN + 1].max():
        return last & False
    others = (wrong & ~last).sum() + 1, ((wrong | right) & ~last).sum() + 2
    chance = (others[0] / others[1]) ** often
    return last & bool((wrong | ~last).all() and chance < 1e-3)
