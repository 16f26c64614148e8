"""Units of columns: what `--map OURS=THEIRS:UNIT` says, what names say, and what cannot be."""

import re
from collections.abc import Sequence

import numpy as np
import pandas as pd

from analysis.tables.words import NO, YES, among
from protocols.columns import Column
from protocols.errors import StudyError
from protocols.plausible_numbers import MIXED, RANGES, SINGLE, point_between_thousands, shifted

UNITS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "deg": {"deg": 1.0, "arcmin": 1 / 60, "arcsec": 1 / 3600, "rad": 57.29577951308232},
    "share": {"share": 1.0, "percent": 1e-2},
    "0/1": {"right": 1.0, "errors": -1.0},
}
"""By the unit of our column: units of others, and what one of them is."""
_SAME = {
    **dict.fromkeys(("msec", "msecs", "millis", "milliseconds", "millisecond"), "ms"),
    **dict.fromkeys(("sec", "secs", "seconds", "second"), "s"),
    **dict.fromkeys(("µs", "μs", "usec", "microseconds"), "us"),
    **dict.fromkeys(("minutes", "minute", "mins"), "min"),
    **dict.fromkeys(("%", "pct", "perc", "percentage"), "percent"),
    **dict.fromkeys(("error", "errors", "err", "wrong", "incorrect"), "errors"),
    **dict.fromkeys(("degrees", "degree", "dva"), "deg"),
}
_WITH_UNIT = re.compile(r"([-+]?[\d.]+(?:e-?\d+)?)\s*([a-zµμ]+|%)", re.IGNORECASE)
_CURRENCY = re.compile(r"[$€£¥₹]|\b(EUR|USD|GBP|CHF|JPY)\b")
_PARTS = re.compile(r"([-+]?\d[^a-zµμ%]*?)(\s*(?:[a-zµμ]+|%))?", re.IGNORECASE)
_GROUPED = re.compile(r"[-+]?[1-9]\d{0,2}([ ,.'\u2019\u00a0\u202f])\d{3}(\1\d{3})*([.,]\d+)?")


def unit_of(column: Column | None, name: str) -> str:
    """Return the unit of our column: declared, or the end of its name."""
    if column is not None:
        return "0/1" if column.kind == "0/1" else column.unit
    tail = name.rpartition("_")[2]
    return tail if tail in UNITS else ""


def known_unit(word: str, base: str) -> str | None:
    """Return a unit's one name, if it is a unit of a column of unit `base` (empty: of any)."""
    name = _SAME.get(word.casefold(), word.casefold())
    return name if any(name in UNITS[one] for one in ([base] if base in UNITS else UNITS)) else None


def said_by(name: str, base: str) -> str | None:
    """Return the unit that a column's name ends in, such as ``RT (ms)``; of shares and times."""
    words = re.findall(r"%|[^\W_]+", re.sub(r"([a-z])([A-Z])", r"\1 \2", name))
    if base not in UNITS or not words or (len(words) == 1 and base != "0/1"):
        return None
    return known_unit(words[-1], base)


def converted(values: pd.Series, unit: str) -> pd.Series:
    """Return texts of numbers in our unit, from that behind each, else `unit`; others stay."""
    if unit == "errors":
        turned = values.mask(among(values, YES), "0")
        return turned.mask(among(values, NO), "1")
    base = next(base for base, table in UNITS.items() if unit in table)
    texts = values.str.strip()
    behind = texts.str.extract(f"^{_WITH_UNIT.pattern}$", flags=re.IGNORECASE)[1]
    own = {word: UNITS[base][known_unit(word, base) or unit] for word in behind.dropna().unique()}
    factor = behind.map(own).astype(float).fillna(UNITS[base][unit])
    bare = texts.str.replace(_WITH_UNIT, r"\1", regex=True)
    numbers = pd.to_numeric(bare, errors="coerce").astype(float)
    return values.where(numbers.isna(), (numbers * factor).map(lambda one: f"{one:.12g}"))


def no_percent(values: pd.Series) -> pd.Series:
    """Return True for numbers up to 1 without ``%`` beside others with it: they may be shares."""
    numbers = pd.to_numeric(values, errors="coerce").abs()
    return numbers.between(0, 1, inclusive="right") & bool(values.str.contains("%").any())


def cure(text: str, option: str) -> str:
    """Return the cure for a cell that is no number, by what stands in it; empty: there is none."""
    found = _WITH_UNIT.fullmatch(text)
    if unit := found and known_unit(found[2], ""):
        return f"; say its unit: {option}:{unit}"
    bare = _CURRENCY.sub("", text).strip()
    if not (parts := _PARTS.fullmatch(bare)):
        return ""
    number, behind = parts.groups("")
    ways = []
    if grouped := _GROUPED.fullmatch(number):
        whole = number.removesuffix(grouped[3] or "").replace(grouped[1], "")
        decimals = (grouped[3] or "").replace(",", ".")
        ways.append(f"thousands without marks between: {whole}{decimals}{behind}")
    if re.fullmatch(r"[-+]?\d+,\d+", number):
        ways.append(f"decimals with a point: {number.replace(',', '.')}{behind}")
    if not ways and bare != text:
        ways.append(f"the number alone: {bare}")
    if not ways and ":" in number:
        ways.append("durations as one number of seconds")
    return "; write " * bool(ways) + ", or ".join(ways)


def impossible(name: str, base: str, values: pd.Series, people: pd.Series | None) -> str:
    """Return the fault of a column, with `people` of one of them; empty: none.

    Of times the median, of shares and angles the largest must be possible.
    """
    known = values.dropna()
    if known.empty:
        return ""
    if base == "s":
        parts = [("", known)]
        if people is not None:
            parts += [(f" of {who}", part) for who, part in known.groupby(people[known.index])]
        for whose, part in parts:
            median = float(part.median())
            shortest, longest = RANGES["median_rt_s"]
            least = shortest if name == "rt_s" else 0.0
            if median > longest or 0.0 < median < least:
                return f"{name} must be in seconds (the median{whose} is {median:g} s)"
    most = float(known.abs().max())
    if base == "deg" and most > RANGES["deg"][1]:
        return f"{name} must be in degrees of visual angle (the largest is {most:g})"
    if base == "share" and most > RANGES["share"][1]:
        return f"{name} must be shares from 0 to 1 (the largest is {most:g})"
    return ""


def odd_one(
    name: str, base: str, values: pd.Series, texts: pd.Series
) -> tuple[int, str, str, bool] | None:
    """Return the first number of a column that stands in another unit, or with a mark of thousands.

    Parameters
    ----------
    values, texts : Series
        Numbers in our unit, and the cells as the user's table has them.

    Returns
    -------
    tuple of int, str, str and bool, or None
        Its label, what must hold, the cure, and whether it is too large. None: there is none.
    """
    bare = texts.str.strip().str.replace(_WITH_UNIT, r"\1", regex=True)[values.notna()]
    if (place := point_between_thousands(bare.to_list())) is not None:
        at = bare.index[place]
        cure = f"write {bare[at].replace('.', '')} for it, and the others so too"
        return at, "must have no mark between thousands", cure, False
    numbers = values.to_numpy(float)
    off, factor = shifted(numbers, MIXED if base == "s" else SINGLE)
    least, most = RANGES.get(name, (-np.inf, np.inf))
    if not off.any():
        off = (values < least).to_numpy() | (values > most).to_numpy()
        factor = 0.0
    if not off.any():
        return None
    at, others = values.index[off][0], values[~off & values.notna()]
    large = factor < 1.0 and values[at] > least
    count = f" in {int(off.sum())} rows" if off.sum() > 1 else ""
    size = (
        f", {max(factor, 1 / factor):,.0f} times too {'large' if large else 'small'}"
        if factor
        else ""
    )
    must = (
        f"must be a number like the others, from {others.min():g} to {others.max():g} (it looks"
        f" like one in another unit{size}{count})"
    )
    return at, must, "bring all to one unit", large


def likely(base: str, values: pd.Series) -> Sequence[str]:
    """Return units in which a column that cannot be in ours would be possible."""
    if base == "s":
        median = float(values.dropna().median())
        return [
            unit for unit, one in UNITS["s"].items() if 0.1 <= median * one <= 30.0 and one != 1.0
        ][:1]
    return ["percent"] if base == "share" and float(values.abs().max()) <= 100.0 else []


def split_unit(text: str, columns: Sequence[str], base: str, option: str) -> tuple[str, str | None]:
    """Return the column and the unit of ``COLUMN`` or ``COLUMN:UNIT``.

    Raises
    ------
    StudyError
        If what follows the colon is no unit of such a column.
    """
    name, colon, word = text.rpartition(":")
    if text in columns or not colon or name not in columns:
        return text, None
    unit = known_unit(word, base)
    if unit is None:
        known = UNITS.get(base) or [each for one in UNITS.values() for each in one]
        raise StudyError(
            f"{option}: must end in one of {', '.join(known)} after the colon (got {word!r})"
        )
    return name, unit
