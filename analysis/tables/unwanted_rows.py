"""Rows that are no data of their own: unanswered, doubled, spoilt by spreadsheets, filtered."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
import pandas as pd

from analysis.tables.words import (
    ANSWERED,
    NO,
    OURS,
    UNANSWERED,
    YES,
    among,
    ended,
    means,
    missing,
    plain,
)
from protocols.browser.shared_links import SLOT, shared_links
from protocols.columns import COMMON_COLUMNS
from protocols.errors import StudyError, count_of

_MONTH = "(jan|feb|m[aä]r|apr|ma[yi]|jun|jul|aug|sep|o[ck]t|nov|de[cz])"
_DATE = re.compile(
    r"\d{4}-\d\d?-\d\d?([ T].*)?|\d\d?[./-]\d\d?[./-](\d\d|\d{4})"
    rf"|\d\d?[-. ]{_MONTH}(-\d\d|-\d{{4}})?|{_MONTH}[- ]\d\d"
    r"|0\d:\d\d|\d\d?:0\d|\d\d?:\d\d:\d\d( [AP]M)?",
    re.IGNORECASE,
)
_PLACE = re.compile(
    r"(lab|laboratory|site|test_?site|group|cent(er|re)|school|clinic|hospital|university|country)s?"
    r"(_?(id|name|code|number|no))?",
    re.IGNORECASE,
)
"""Columns that are one for a person."""
_SERIAL = re.compile(r"[345]\d{4}(\.0)?")
"""A day since 1900, as spreadsheets count it: 1982 to 2064."""
_CLOCKS = {"timestamp", "time_elapsed"}
_MANY = 5
"""Fewest wrong answers of which a person surely gave some."""
_RUN = 5
"""So many rows in their order, with different times in them, come twice only if copied."""
_HALF = 8
_ZEROS = re.compile(r"(?<![\d.])0+(?=\d)")
_PREFIX = re.compile(r"[a-z]{1,3}(?=\d)")
OPERATORS: dict[str, Callable[[pd.Series, float], pd.Series]] = {
    "<": lambda values, one: values < one,
    "<=": lambda values, one: values <= one,
    ">": lambda values, one: values > one,
    ">=": lambda values, one: values >= one,
}
CONDITION = re.compile(r"\s*(.+?)\s*(<=|>=|!=|==|=|<|>)\s*(.*?)\s*")


def kept(values: pd.Series, sign: str, wanted: str) -> pd.Series | str:
    """Return True where a condition, ``>= 0.5``, holds, or the first value that has no place."""
    numbers = pd.to_numeric(values.str.strip(), errors="coerce").astype(float)
    number = float(pd.to_numeric(pd.Series([wanted]), errors="coerce").iloc[0])
    empty = missing(values)
    if sign in OPERATORS:
        odd = values[numbers.isna() & ~empty]
        if number != number or not odd.empty:
            return wanted if number != number else str(odd.iloc[0])
        return OPERATORS[sign](numbers, number)
    same = values.str.strip() == wanted
    if number == number:
        same |= numbers == number
    elif bool(missing(pd.Series([wanted])).iloc[0]) and not same.any():
        same = empty
    return ~same if sign == "!=" else same


def spoilt(values: pd.Series) -> tuple[pd.Series, bool]:
    """Return True for names that look like a spreadsheet's date, and whether all do."""
    unique = [one for one in values.unique() if one]
    dates = {one for one in unique if _DATE.fullmatch(one)}
    others = [one for one in unique if one not in dates]
    if not all(re.fullmatch(r"[\d.]+", one) for one in others):
        dates |= {one for one in others if _SERIAL.fullmatch(one)}
    return values.isin(dates), len(dates) == len(unique)


class CheckedRows(Protocol):
    """Rows of a table, with what was noted and asked for."""

    path: Path
    rows: pd.DataFrame
    notes: list[str]
    filtered: set[str]
    bounded: set[tuple[str, str]]

    def cure(self, words: str) -> str:
        """Return an option as the command at hand takes it."""

    def leave_out(self, out: pd.Series, why: str) -> None:
        """Leave rows out, and note how many."""


def leave_out_unanswered(
    table: CheckedRows,
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


def _at_limit(table: CheckedRows, name: str, right: pd.Series, wrong: pd.Series) -> pd.Series:
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


def look_alike(values: Iterable[str], *, codes: bool) -> list[list[str]]:
    """Return names that a person would take for one; of codes also ``1`` and ``P01``."""
    groups: dict[str, list[str]] = {}
    for one in sorted(set(values)):
        key = re.sub(r"[\s_.-]+(?!\d)|[\s_]+", "", one.casefold())
        groups.setdefault(_ZEROS.sub("", key), []).append(one)
    if codes:
        for key in [key for key in groups if not key.isdigit()]:
            bare = _ZEROS.sub("", _PREFIX.sub("", key, count=1).lstrip("-"))
            if bare in groups and bare != key:
                groups[bare] += groups.pop(key)
    return [sorted(group) for group in groups.values() if len(group) > 1]


def shared_names(rows: pd.DataFrame, option: str, code: str) -> list[str]:
    """Return notes on codes that come in several labs or groups, and on slots of several people."""
    notes = []
    who = rows["participant"].str.strip()
    for name in filter(_PLACE.fullmatch, map(str, rows.columns)):
        places = rows[name].str.strip().mask(missing(rows[name])).groupby(who).nunique()
        if several := int((places > 1).sum()):
            notes.append(
                f"{several} of {count_of(len(places), 'participant code')} come in several of"
                f" {name}: each counts as one person; if others have the same code there, say"
                f" {option} participant={name}+{code}"
            )
    if "slot" in rows:
        slots = rows["slot"].str.strip().groupby(who).unique()
        marks = {str(one): [(SLOT, slot) for slot in own if slot] for one, own in slots.items()}
        notes += map(str, shared_links(marks))
    return notes


def doubled(rows: pd.DataFrame) -> tuple[int, int] | None:
    """Return the labels of two equal rows where a part of a table was pasted twice.

    Equal rows alone are no mistake. Copied are most of a participant's rows if they hold times,
    several in their order with the same times, all rows of a table in their order again, or those
    of single participants.
    """
    codes = pd.Series(pd.factorize(pd.util.hash_pandas_object(rows, index=False))[0], rows.index)
    clocks = [
        name
        for name in rows.columns
        if means(str(name), OURS["rt_s"]) or str(name).casefold().rpartition(".")[2] in _CLOCKS
    ]
    clocks = [name for name in clocks if rows[name].nunique() >= max(_RUN, len(rows) // 10)]
    if clocks:
        people = rows["participant"] if "participant" in rows else codes * 0
        timed = codes[~missing(rows[clocks[0]])]
        many = timed.duplicated(keep=False).groupby(people).agg(["mean", "size"])
        copied = many.index[(many["mean"] > 0.5) & (many["size"] >= 2 * _RUN)]
        if len(copied):
            own = timed[people == copied[0]]
            second = own.index[own.duplicated()][0]
            return int(own.index[own == own[second]][0]), int(second)
        runs = pd.concat([codes.shift(-step) for step in range(_RUN)], axis=1).dropna()
        varied = (np.diff(np.sort(runs.to_numpy(), axis=1), axis=1) > 0).all(axis=1)
        again = np.flatnonzero(runs.duplicated().to_numpy() & varied)
        if again.size:
            same = (runs.to_numpy() == runs.to_numpy()[again[0]]).all(axis=1)
            return int(runs.index[int(np.argmax(same))]), int(runs.index[again[0]])
    people = rows["participant"] if "participant" in rows else pd.Series("", rows.index)
    parts = [codes]
    sizes = people.value_counts()
    if len(sizes) < 2:
        return None
    twice = [who for who in sizes.index if sizes[who] % 2 == 0 and (sizes == sizes[who] // 2).any()]
    parts += (codes[people == who] for who in twice)
    for part in parts:
        half, odd = divmod(len(part), 2)
        if not odd and half >= _HALF and part.nunique() > 1:
            values = part.to_numpy()
            if (values[:half] == values[half:]).all():
                return int(part.index[0]), int(part.index[half])
    return None
