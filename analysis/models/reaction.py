"""Reaction times: summaries that a few slow answers do not move."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from analysis.arrays import Floats
from analysis.models.numeric import two_sided_quantile


@dataclass(frozen=True)
class ReactionTimes:
    """Reaction times of one condition, in seconds.

    `median` and quartiles are of all answers; `mean_of_medians` and its t limits are over the
    participants' medians, taken on the logarithm; `trimmed_mean` drops 10 % at either end.
    """

    condition: str
    answers: int
    participants: int
    median: float
    quartile_low: float
    quartile_high: float
    trimmed_mean: float
    mean_of_medians: float
    lower: float
    upper: float
    warnings: tuple[str, ...]


def reaction_times(
    decisions: pd.DataFrame, by: Sequence[str] = (), *, level: float = 0.95
) -> tuple[ReactionTimes, ...]:
    """Summarise ``rt_s`` (seconds, by ``participant``) for each combination of the columns `by`.

    Times that are missing or not above 0 do not count; empty where none is left.
    """
    rows = decisions[decisions["rt_s"].notna() & (decisions["rt_s"] > 0)]
    if rows.empty:
        return ()
    return tuple(_summary(name, part, level) for name, part in _groups(rows, by))


def participant_medians(
    decisions: pd.DataFrame, by: Sequence[str] = ()
) -> dict[str, tuple[float, ...]]:
    """Return participants' medians of ``rt_s`` in each condition, as `reaction_times` names it."""
    rows = decisions[decisions["rt_s"] > 0]
    return {
        name: tuple(map(float, part.groupby("participant")["rt_s"].median()))
        for name, part in _groups(rows, by)
    }


def _mean_with_limits(values: Floats, level: float) -> tuple[float, float, float]:
    """Return the mean of people's values and its t limits.

    Values that are NaN are left out; one person has no limits, nobody no mean.
    """
    own = values[np.isfinite(values)]
    mean = float(own.mean()) if own.size else math.nan
    if own.size < 2:
        return mean, math.nan, math.nan
    error = float(own.std(ddof=1)) / math.sqrt(own.size)
    reach = float(two_sided_quantile(level, float(own.size - 1))) * error
    return mean, mean - reach, mean + reach


def _groups(rows: pd.DataFrame, by: Sequence[str]) -> list[tuple[str, pd.DataFrame]]:
    if not by:
        return [("all trials", rows)]
    return [(" · ".join(map(str, key)), part) for key, part in rows.groupby(list(by), sort=True)]


def _summary(condition: str, rows: pd.DataFrame, level: float) -> ReactionTimes:
    times = rows["rt_s"].to_numpy(dtype=np.float64)
    cut = times.size // 10
    medians = np.log(rows.groupby("participant")["rt_s"].median().to_numpy(dtype=np.float64))
    mean, lower, upper = _mean_with_limits(medians, level)
    notes = ["one participant only: no limits"] * (medians.size < 2)
    if times.size < 4 * medians.size:
        notes.append("fewer than 4 answers per participant")
    return ReactionTimes(
        condition=condition,
        answers=times.size,
        participants=medians.size,
        median=float(np.median(times)),
        quartile_low=float(np.quantile(times, 0.25)),
        quartile_high=float(np.quantile(times, 0.75)),
        trimmed_mean=float(np.sort(times)[cut : times.size - cut].mean()),
        mean_of_medians=float(np.exp(mean)),
        lower=float(np.exp(lower)),
        upper=float(np.exp(upper)),
        warnings=tuple(notes),
    )
