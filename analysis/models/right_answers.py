"""Rates of right answers: shares with limits and tests against chance, by condition."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.special import ndtri

from analysis.arrays import Floats
from analysis.models.cells import TrialGrid, checked, conditions, grid
from analysis.models.clustered import (
    ClusteredEstimate,
    holm,
    two_way,
    two_way_difference,
    two_way_influence,
)
from analysis.models.contrasts import MEAN, Difference, pairs_of
from analysis.models.numeric import exact_binomial
from analysis.showable import two_scenes
from protocols.errors import count_of

FEW_PARTICIPANTS = 6


@dataclass(frozen=True)
class Rate:
    """A share of trials with limits that respect participants and scenes.

    Attributes
    ----------
    condition : str
    count, trials, participants, scenes : int
    share, lower, upper : float
        Limits lie in [0, 1]; they leave out `chance` exactly where p < 1 - level.
    chance : float
        What p tests against.
    p : float
        Two-sided, clustered.
    exact_p : float
        Pooled exact binomial, as papers print it: takes trials as independent.
    """

    condition: str
    count: int
    trials: int
    share: float
    lower: float
    upper: float
    level: float
    chance: float
    p: float
    exact_p: float
    participants: int
    scenes: int
    warnings: tuple[str, ...]


def correct_rates(
    trials: pd.DataFrame,
    by: Sequence[str] = (),
    *,
    chance: float,
    level: float = 0.95,
) -> tuple[Rate, ...]:
    """Return the share of right answers in each condition.

    Parameters
    ----------
    trials : DataFrame, one row per decided trial
        ``participant``, ``scene`` (optional), ``correct`` (0/1) and the columns `by`.
    chance : float
        1 / m for m alternatives, in (0, 1).

    Raises
    ------
    ValueError
        If columns are missing, or ``correct`` holds anything but 0 and 1.
    """
    if not 0.0 < chance < 1.0:
        raise ValueError(f"chance must lie between 0 and 1 (got {chance})")
    rows = checked(trials, ("correct",), by)
    places = grid(rows)
    return tuple(
        rate(part["correct"], places, condition=name, chance=chance, level=level)
        for name, part in conditions(rows, by)
    )


def rate(
    event: pd.Series, places: TrialGrid, *, condition: str, chance: float = 0.5, level: float = 0.95
) -> Rate:
    """Return the share of one condition's trials (0/1) in which something happened."""
    happened, shown = places.count(event), places.count(event * 0 + 1)
    count, total = int(happened.sum()), int(shown.sum())
    exact_p, *ends = exact_binomial(count, total, chance, level)
    people, scenes = (int((shown.sum(axis=axis) > 0).sum()) for axis in (1, 0))
    notes = two_scenes(scenes)
    if people < 2:
        (lower, upper), p = ends, exact_p
        notes.append("one participant only: limits speak about this person's trials")
    else:
        estimate = two_way(happened, shown)
        lower, upper = (float(limit) for limit in estimate.limits(level, chance))
        p, held = float(estimate.p_value(chance)), estimate.held(chance)
        if held:
            notes.append(held)
        if people < FEW_PARTICIPANTS:
            notes.append(f"only {count_of(people, 'participant')}: limits and p are a rough guide")
    return Rate(
        condition=condition,
        count=count,
        trials=total,
        share=count / total,
        lower=lower,
        upper=upper,
        level=level,
        chance=chance,
        p=p,
        exact_p=exact_p,
        participants=people,
        scenes=scenes,
        warnings=tuple(notes),
    )


def rate_contrasts(
    trials: pd.DataFrame,
    by: Sequence[str],
    *,
    reference: str | None = None,
    level: float = 0.95,
) -> tuple[Difference, ...]:
    """Compare the shares of right answers between conditions (against one, or all pairs).

    Columns and errors are those of `correct_rates`; p is Holm-adjusted over the comparisons.
    """
    rows = checked(trials, ("correct",), by)
    places = grid(rows)
    moved = {name: event_influence(part["correct"], places) for name, part in conditions(rows, by)}
    return contrasts("share correct", moved, reference=reference, level=level)


@dataclass(frozen=True)
class CorrectedRates:
    """Rates whose normal quantiles, weighted, are an estimate: each with half a trial either way.

    Attributes
    ----------
    count, total : ndarray (..., rates)
        Of each rate.
    weights : tuple of float (rates,)
    """

    count: Floats
    total: Floats
    weights: tuple[float, ...]

    def of_trials(self, total: Floats) -> Floats:
        """Return the estimate (...) if the same rates were of so many trials (..., rates)."""
        share = (self.count / self.total * total + 0.5) / (total + 1.0)
        return np.asarray(ndtri(share) @ np.array(self.weights))

    def apart(self, other: "CorrectedRates") -> Floats:
        """Return the part of the difference to another that numbers of trials alone make."""
        least = np.minimum(self.total, other.total)
        own = self.of_trials(self.total) - other.of_trials(other.total)
        return own - (self.of_trials(least) - other.of_trials(least))


@dataclass(frozen=True)
class Influence:
    """An estimate (...), what cells (..., participants, scenes) move it, and its least variance.

    `most` is the largest difference of two such estimates that there can be: 1 of shares. `rates`
    are those of an estimate that stands on a correction.
    """

    value: Floats
    cells: Floats
    shown: Floats
    least: Floats
    most: float = math.inf
    rates: CorrectedRates | None = None

    def estimate(self) -> ClusteredEstimate:
        """Return the estimate with its clustered error."""
        return two_way_influence(self.value, self.cells, self.shown, self.least)

    def minus(self, other: "Influence") -> "Influence":
        """Return the difference to another on the same grid."""
        return Influence(
            self.value - other.value,
            self.cells - other.cells,
            self.shown + other.shown,
            # Trials of one person rise and fall together: a difference can vary less than
            # independent trials would, but half of that is the least to believe.
            0.5 * (self.least + other.least),
            self.most + other.most,
        )

    def less(self, other: "Influence") -> ClusteredEstimate:
        """Return its surplus over another on the same grid, each participant's own control.

        What a correction makes of it, because one had more trials, counts as error.
        """
        gap = self.minus(other)
        found = two_way_difference(
            gap.value, (self.cells, other.cells), (self.shown, other.shown), gap.least
        )
        if self.rates is None or other.rates is None:
            return found
        error = np.hypot(found.standard_error, self.rates.apart(other.rates))
        return replace(found, standard_error=error)


def mean_influence(several: Collection[Influence]) -> Influence:
    """Return the mean of estimates on one grid."""
    value, cells, shown, least = (
        np.array([getattr(one, name) for one in several])
        for name in ("value", "cells", "shown", "least")
    )
    return Influence(
        value.mean(axis=0),
        cells.mean(axis=0),
        shown.sum(axis=0),
        least.mean(axis=0) / len(several),
        max(one.most for one in several),
    )


def share_influence(happened: Floats, shown: Floats) -> Influence:
    """Return the influence of cells on a share; a rate of 0 or 1 keeps half a trial's variance."""
    count, total = happened.sum(axis=(-2, -1)), shown.sum(axis=(-2, -1))
    share, mild = count / total, (count + 0.5) / (total + 1.0)
    cells = (happened - shown * share[..., None, None]) / total[..., None, None]
    return Influence(share, cells, shown, mild * (1.0 - mild) / total, most=1.0)


def event_influence(event: pd.Series, places: TrialGrid) -> Influence:
    """Return the influence of cells on the share of trials in which something happened."""
    return share_influence(places.count(event), places.count(event * 0 + 1))


def contrasts(
    measure: str,
    moved: dict[str, Influence],
    *,
    reference: str | None = None,
    level: float = 0.95,
) -> tuple[Difference, ...]:
    """Compare conditions counted on one grid; limits end at the largest difference of shares."""
    found, pairs = [], pairs_of(moved, reference)
    if any(MEAN in pair for pair in pairs):
        moved = {MEAN: mean_influence(moved.values()), **moved}
    for first, second in pairs:
        gap = moved[first].less(moved[second])
        lower, upper = np.clip(gap.limits(level), -moved[first].most, moved[first].most)
        found.append((first, second, gap, float(lower), float(upper), float(gap.p_value())))
    adjusted = holm(np.array([p for *_, p in found])) if found else np.zeros(0)
    return tuple(
        Difference(
            measure=measure,
            first=first,
            second=second,
            difference=float(gap.value),
            standard_error=float(gap.standard_error),
            lower=lower,
            upper=upper,
            level=level,
            df=float(gap.df),
            p=p,
            p_adjusted=float(p_adjusted),
        )
        for (first, second, gap, lower, upper, p), p_adjusted in zip(found, adjusted, strict=True)
    )


def share_interactions(
    happened: Mapping[str, Mapping[str, pd.Series]], places: TrialGrid, measure: str, level: float
) -> tuple[Difference, ...]:
    """Return the differences of a share between all pairs of values of the factor.

    Parameters
    ----------
    happened : mapping of value to (mapping of condition to Series of 0 and 1)
        Trials on the grid. With two conditions, it is the difference of their shares that differs.

    Notes
    -----
    `clustered.two_way_difference`: scenes may be seen at one value only, and participants too.
    """
    moved = {}
    for value, several in happened.items():
        each = [event_influence(event, places) for event in several.values()]
        moved[value] = each[0] if len(each) == 1 else each[0].minus(each[1])
    return contrasts(measure, moved, level=level)
