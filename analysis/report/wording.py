"""Numbers in words, as APA style writes them, and what every report says."""

import math
import unicodedata
from collections.abc import Sequence
from typing import Protocol, TypeAlias

from analysis.exclusions import FlowStep

REPLACED = "\N{REPLACEMENT CHARACTER}"
# Control, format (among them bidirectional overrides), surrogate, private use.
_UNPRINTABLE = {"Cc", "Cf", "Cs", "Co"}

Ends: TypeAlias = tuple[float | None, float | None]
"""Limits of an estimate; None where it has none."""

NOT_IDENTIFIED = "not identified by these data"
NONE = "none"
"""In place of a number that is NaN: the data do not identify it."""


def p_text(p: float) -> str:
    """Return ``p = .012``, ``p < .001``, ``no p`` for NaN; never ``p = .000`` or ``p = 1.000``."""
    if math.isnan(p):
        return "no p"
    if p < 0.001:
        return "p < .001"
    if p > 0.999:
        return "p > .999"
    return "p = " + leading(f"{p:.3f}")


def p_number(p: float | None) -> str:
    """Return a p-value for a table: ``.012``, ``< .001``, ``none`` for None and NaN."""
    if p is None or math.isnan(p):
        return NONE
    return p_text(p).removeprefix("p ").removeprefix("= ")


def leading(number: str) -> str:
    """Drop the zero before the point of a number that cannot exceed 1."""
    return number.replace("0.", ".", 1) if number.lstrip("-").startswith("0.") else number


def share(value: float) -> str:
    """Return a share with two digits; ``none`` for NaN."""
    return NONE if math.isnan(value) else leading(f"{value:.2f}")


def share_range(lower: float, upper: float) -> str:
    """Return limits of a share; ``none`` for NaN."""
    return NONE if math.isnan(lower) else f"[{share(lower)}, {share(upper)}]"


def big(value: float) -> str:
    """Return an odds ratio or the like in at most four digits."""
    if math.isnan(value):
        return NONE
    if math.isinf(value):
        return "\N{INFINITY}"
    if value == 0.0:
        return "0"
    if value >= 1e4:
        mantissa, power = f"{value:.1e}".split("e")
        return f"{mantissa}e{int(power)}"
    if value >= 100:
        return f"{value:.0f}"
    if value >= 10:
        return f"{value:.1f}"
    return f"{value:.2f}" if value >= 0.01 else f"{value:.1e}"


def needed(ends: Ends | None) -> int:
    """Return the decimals that show two digits of the width of limits; 0 where there is none."""
    lower, upper = ends or (None, None)
    width = math.nan if lower is None or upper is None else abs(upper - lower)
    if not (math.isfinite(width) and width > 0):
        return 0
    return max(0, 1 - math.floor(math.log10(width)))


def number(value: float, digits: int = 2, *, within: Ends | None = None) -> str:
    """Return a number with so many digits, never ``-0.00``; ``none`` for NaN, or endless.

    `within` are limits, whose width may need more digits.
    """
    if math.isnan(value):
        return NONE
    if math.isinf(value):
        return "\N{INFINITY}" if value > 0 else "-\N{INFINITY}"
    text = f"{value:.{max(digits, needed(within))}f}"
    return text.lstrip("-") if float(text) == 0 else text


def number_range(lower: float, upper: float) -> str:
    """Return limits of a number; ``none`` for NaN."""
    ends = (lower, upper)
    return NONE if math.isnan(lower) else f"[{', '.join(number(e, within=ends) for e in ends)}]"


class IntervalEstimate(Protocol):
    """An estimate with limits."""

    @property
    def lower(self) -> float:
        """The lower one."""

    @property
    def upper(self) -> float:
        """The upper one."""


def placed(one: IntervalEstimate, value: float) -> str:
    """Return the value of an estimate with as many digits as its limits have."""
    return number(value, within=(one.lower, one.upper))


def by_how_much(one: IntervalEstimate, value: float, unit: str, words: tuple[str, str]) -> str:
    """Return a difference with the word of its sign: ``0.19 SD below``.

    `words` are those of more and of less. The limits beside it keep their signs.
    """
    return f"{placed(one, abs(value))}{unit and f' {unit}'} {words[value < 0.0]}"


def level_text(level: float) -> str:
    """Return the words before limits in a sentence: ``95% CI``."""
    return f"{100 * level:g}% CI"


def df_text(df: float, t: float = 0.0) -> str:
    """Return degrees of freedom: one digit after the point where they are not whole.

    ``none`` for NaN, and where the statistic `t` that they are of is none.
    """
    return NONE if math.isnan(df) or math.isnan(t) else f"{round(df, 1):.10g}"


def law(df: float | None, t: float = 0.0) -> str:
    """Return ``t(5)``; ``z`` where there are no degrees of freedom, or no end of them.

    ``none`` where the statistic `t` that follows it is none.
    """
    if math.isnan(t):
        return NONE
    return "z" if df is None or math.isinf(df) else f"t({df_text(df)})"


def t_text(t: float, df: float | None, none: str = "no t") -> str:
    """Return a statistic with its law: ``t(5) = 2.31``; ``no t`` for NaN, or `none`."""
    return none if math.isnan(t) else f"{law(df)} = {number(t)}"


def t_number(t: float | None, df: float | None) -> str:
    """Return a statistic with its degrees of freedom for a table: ``2.31 (5)``."""
    if t is None or df is None or math.isnan(t) or math.isnan(df):
        return NONE
    return f"{number(t)} ({df_text(df)})"


def size(value: float | None, digits: int = 3, *, within: Ends | None = None) -> str:
    """Return a level or the like in so many significant digits; ``none`` for None and NaN.

    `within` are limits: these and the value end at the same digit after the point, as many as the
    largest of them has, or as their width needs (442.3 where they are 441.8 and 442.9).
    """
    if value is None or math.isnan(value):
        return NONE
    if value == 0:
        return "0"
    more, above = needed(within), math.floor(math.log10(abs(value)))
    ends = [abs(end) for end in within or () if end and math.isfinite(end)]
    largest = math.floor(math.log10(max([abs(value), *ends])))
    if -5 < largest < 7 and (len({*(within or ())}) > 1 or above >= digits):
        text = number(value, max(digits - 1 - largest, more, 0))
        if float(text) != 0 or (within and (within[0] or 0.0) <= 0.0):
            return text
    return f"{value:.{max(digits, above + 1 + more) if more else digits}g}"


def size_range(ends: Ends | None) -> str:
    """Return limits of a level or the like; ``none`` for None and NaN."""
    texts = [NONE] if ends is None else [size(end, within=ends) for end in ends]
    return NONE if NONE in texts else f"[{', '.join(texts)}]"


def column_in_words(column: str) -> str:
    """Return the name of a column as people read it: eccentricity_deg is "eccentricity (deg)"."""
    for unit in ("deg", "px", "m", "s"):
        if column.endswith(f"_{unit}"):
            column = f"{column.removesuffix(f'_{unit}')} ({unit})"
    return column.replace("_", " ")


def printable(text: str) -> str:
    """Return free text without characters that break or reorder a page, each as a mark."""
    return "".join(
        mark if mark in "\n\t" or unicodedata.category(mark) not in _UNPRINTABLE else REPLACED
        for mark in text
    )


def left_out_sentence(flow: Sequence[FlowStep]) -> str:
    """Return the rows that rules fixed beforehand left out, as a sentence with a blank after it."""
    left_out = sum(step.sittings_out for step in flow)
    single = sum(step.decisions_out for step in flow if step.sittings_out == 0)
    return (
        f"Rules fixed before data collection left out {left_out}"
        f" participant{'s' * (left_out != 1)} and {single} single"
        f" trial{'s' * (single != 1)}. "
    )
