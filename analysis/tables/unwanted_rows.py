"""Rows that are no data of their own: doubled ones, names that spreadsheets spoilt, filters."""

import re
from collections.abc import Callable, Iterable

import numpy as np
import pandas as pd

from analysis.tables.words import means, missing
from protocols.browser.shared_links import SLOT, shared_links
from protocols.columns import Column
from protocols.errors import count_of

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


def doubled(rows: pd.DataFrame, times: Column) -> tuple[int, int] | None:
    """Return the labels of two equal rows where a part of a table was pasted twice.

    Equal rows alone are no mistake. Copied are most of a participant's rows if they hold times,
    several in their order with the same times, all rows of a table in their order again, or those
    of single participants.
    """
    codes = pd.Series(pd.factorize(pd.util.hash_pandas_object(rows, index=False))[0], rows.index)
    clocks = [
        name
        for name in rows.columns
        if means(str(name), times) or str(name).casefold().rpartition(".")[2] in _CLOCKS
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
