"""Which conditions are compared with which, and Wald's comparisons of what was estimated."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from analysis.clustered import holm
from protocols.errors import StudyError

Floats = NDArray[np.float64]
Pair = tuple[str, str]
MOST_CONDITIONS = 200


@dataclass(frozen=True)
class Gap:
    """How far one condition's value exceeds another's, with t limits; Holm over all pairs."""

    first: str
    second: str
    difference: float
    standard_error: float
    lower: float
    upper: float
    p: float
    p_adjusted: float


def unidentified(gap: Gap) -> Gap:
    """Return a comparison that the data do not identify: without numbers."""
    nan = math.nan
    return Gap(gap.first, gap.second, nan, nan, nan, nan, nan, nan)


def check_conditions(count: int) -> None:
    """Refuse to compare what can hardly be conditions: a column of file names, say.

    Raises
    ------
    StudyError
        If there are more than `MOST_CONDITIONS`.
    """
    if count > MOST_CONDITIONS:
        raise StudyError(
            f"at most {MOST_CONDITIONS} conditions must be compared (found {count:,}); name the"
            " column that holds them, or leave rows out with --where"
        )


def pairs_of(names: Iterable[str], reference: str | None) -> list[Pair]:
    """Return all pairs of conditions, or each with the one that others are compared with.

    Raises
    ------
    ValueError
        If `reference` is no condition.
    StudyError
        If there are more conditions than a study compares.
    """
    known = list(names)
    check_conditions(len(known))
    if reference is None:
        return list(combinations(known, 2))
    if reference not in known:
        raise ValueError(f"reference must be one of {known} (got {reference!r})")
    return [(name, reference) for name in known if name != reference]


def wald(
    names: Sequence[str], pairs: Sequence[Pair], value: Floats, covariance: Floats, *,
    df: int, level: float,
) -> list[Gap]:  # fmt: skip
    """Compare conditions by their values (names,) and the covariance of these."""
    if not pairs:
        return []
    place = {name: k for k, name in enumerate(names)}
    first, second = (np.array([place[pair[side]] for pair in pairs]) for side in (0, 1))
    gap = value[first] - value[second]
    variance = covariance[first, first] + covariance[second, second]
    error = np.sqrt((variance - 2.0 * covariance[first, second]).clip(min=1e-300))
    reach = float(stats.t.ppf(0.5 + 0.5 * level, df)) * error
    p = 2.0 * stats.t.sf(np.abs(gap) / error, df)
    numbers = np.column_stack([gap, error, gap - reach, gap + reach, p, holm(p)])
    return [Gap(*pair, *row) for pair, row in zip(pairs, numbers.tolist(), strict=True)]


def paired(gaps: Sequence[tuple[Pair, Floats]], level: float) -> list[tuple[Gap, int]]:
    """Compare conditions by participants' own differences; beside each its degrees of freedom."""
    rows = []
    for pair, own in gaps:
        mean, df = float(own.mean()), own.size - 1
        error = float(own.std(ddof=1) / np.sqrt(own.size))
        reach = float(stats.t.ppf(0.5 + 0.5 * level, df)) * error
        p = float(2.0 * stats.t.sf(abs(mean) / max(error, 1e-12), df))
        rows.append(((*pair, mean, error, mean - reach, mean + reach, p), df))
    adjusted = holm(np.array([row[-1] for row, _ in rows])).tolist() if rows else []
    return [(Gap(*row, one), df) for (row, df), one in zip(rows, adjusted, strict=True)]
