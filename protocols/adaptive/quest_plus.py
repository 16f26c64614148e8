"""QUEST+: show the level from which the answer is expected to tell most.

Watson 2017, "QUEST+: A general multidimensional Bayesian adaptive psychometric method", Journal
of Vision 17(3):10. Here: one stimulus dimension (the level), two answers (correct or not, or
yes and no), and four parameters on a grid: guess, threshold, width, lapse. See
`protocols.adaptive.psychometric_function` for what they mean.

**Posterior.** Prior times the likelihood of every answer, summed to 1. Only the counts of both
answers at each level enter, so the order of the answers changes nothing, not even the rounding.

**Next level.** For each level, average the entropy of the posterior that would follow over the
two answers, each with the probability that the present posterior gives it; take the level with
the least. With w the posterior over the grid points g, p(x, g) the psychometric function, and
h(p) the entropy of one answer, that average is ::

    EH(x) = H(w) - [h(sum_g w p(x, g)) - sum_g w h(p(x, g))]

The bracket is what the answer is expected to tell, in nats. It needs two products of a table
with a vector, where the definition needs two posteriors and their entropies for each level.

**Ties.** Of levels that differ by less than `TIE_NATS`, the lowest is taken. Otherwise the last
bit of a library's exp or log would decide, and two machines could disagree.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import lru_cache

import numpy as np
from scipy.special import entr

from protocols.adaptive.answer_history import History, Shape, check_history, check_rising
from protocols.adaptive.psychometric_function import Floats, check_shape, probability
from protocols.errors import StudyError

PARAMETERS = ("guess", "threshold", "width", "lapse")
"""Axes of the posterior, in this order."""

TIE_NATS = 1e-9

P_FLOOR = 1e-12
"""No answer is held impossible: a slip of the finger must not rule out every grid point."""


@dataclass(frozen=True)
class Axis:
    """The values of one parameter, and what is believed of them beforehand.

    Attributes
    ----------
    values : tuple of float
        Rising. One value means that the parameter is known.
    weights : tuple of float
        Prior, not negative, in any scale; empty means the same for each value.
    """

    values: tuple[float, ...]
    weights: tuple[float, ...] = ()

    def prior(self) -> Floats:
        """Return the prior (values,), which sums to 1."""
        if not self.weights:
            return np.full(len(self.values), 1.0 / len(self.values))
        weights = np.asarray(self.weights, dtype=np.float64)
        return np.asarray(weights / weights.sum())


@dataclass(frozen=True)
class Grid:
    """Levels that may be shown, and every observer that is thought possible.

    Attributes
    ----------
    levels : tuple of float
        The levels that may be shown, rising, in the unit of the stimulus.
    threshold, width : Axis
        In the unit of the stimulus. Thresholds lie within the range of the levels.
    guess, lapse : Axis
        Rates; guess + lapse stays below 1.
    shape : "gauss", "logistic", "gumbel" or "weibull"
    falling : bool
        Performance falls with the level.

    Raises
    ------
    StudyError
        If an axis is empty or out of order, a value impossible, or the levels cannot be used.
    """

    levels: tuple[float, ...]
    threshold: Axis
    width: Axis
    guess: Axis = field(default=Axis((0.5,)))
    lapse: Axis = field(default=Axis((0.02,)))
    shape: Shape = "gauss"
    falling: bool = False

    def __post_init__(self) -> None:
        """Check everything that can be checked without data."""
        check_shape(self.shape)
        check_rising(self.levels)
        for name in PARAMETERS:
            _check_axis(getattr(self, name), name)
        low, high = self.levels[0], self.levels[-1]
        outside = [value for value in self.threshold.values if not low <= value <= high]
        if outside:
            raise StudyError(
                f"threshold: must lie within the levels, from {low:g} to {high:g} (got"
                f" {', '.join(f'{value:g}' for value in outside)}); no level could tell such"
                " thresholds apart: add levels, or leave these values out"
            )
        if self.width.values[0] <= 0:
            raise StudyError(
                f"width: must be greater than 0 (got {self.width.values[0]:g});"
                " where performance falls with the level, set falling"
            )
        for name, axis in (("guess", self.guess), ("lapse", self.lapse)):
            if axis.values[0] < 0:
                raise StudyError(f"{name}: must be at least 0 (got {axis.values[0]:g})")
        top = self.guess.values[-1] + self.lapse.values[-1]
        if top >= 1:
            raise StudyError(f"guess + lapse: must stay below 1 (got up to {top:g})")
        if self.shape == "weibull" and (low < 0 or self.threshold.values[0] <= 0):
            raise StudyError(
                "shape: weibull needs levels of at least 0 and thresholds above 0 (got levels"
                f" from {low:g}, thresholds from {self.threshold.values[0]:g});"
                " for levels that are logarithms take gumbel"
            )

    @property
    def size(self) -> tuple[int, int, int, int]:
        """Shape of the posterior, in the order of `PARAMETERS`."""
        guess, threshold, width, lapse = (len(getattr(self, name).values) for name in PARAMETERS)
        return guess, threshold, width, lapse


@dataclass(frozen=True, eq=False)
class Tables:
    """Tables that depend on the grid alone; all (levels, grid points) but the prior."""

    rows: Mapping[float, int]
    correct: Floats
    log_correct: Floats
    log_wrong: Floats
    answer_entropy: Floats
    log_prior: Floats


@lru_cache(maxsize=8)
def tables(grid: Grid) -> Tables:
    """Return the tables of a grid."""
    axes = np.ix_(
        *(np.asarray(getattr(grid, name).values, dtype=np.float64) for name in PARAMETERS)
    )
    guess, threshold, width, lapse = (axis[None] for axis in axes)
    correct = probability(
        np.asarray(grid.levels)[:, None, None, None, None],
        threshold=threshold,
        width=width,
        guess=guess,
        lapse=lapse,
        shape=grid.shape,
        falling=grid.falling,
    )
    correct = np.clip(correct, P_FLOOR, 1.0 - P_FLOOR).reshape(len(grid.levels), -1)
    prior = np.ones(1)
    for name in PARAMETERS:
        prior = np.multiply.outer(prior, getattr(grid, name).prior())
    with np.errstate(divide="ignore"):  # a weight of 0 rules a value out
        log_prior = np.log(prior.reshape(-1))
    made = Tables(
        rows={level: row for row, level in enumerate(grid.levels)},
        correct=correct,
        log_correct=np.log(correct),
        log_wrong=np.log1p(-correct),
        answer_entropy=entr(correct) + entr(1.0 - correct),
        log_prior=log_prior,
    )
    for part in fields(made)[1:]:
        getattr(made, part.name).flags.writeable = False
    return made


def posterior(history: History, grid: Grid) -> Floats:
    """Return the posterior (guess, threshold, width, lapse); it sums to 1.

    Raises
    ------
    StudyError
        If a level of the history is not in the grid.
    """
    return _posterior(history, grid).reshape(grid.size)


def _posterior(history: History, grid: Grid) -> Floats:
    check_history(history, grid.levels)
    known = tables(grid)
    counts = np.zeros((2, len(grid.levels)))
    for level, correct in history:
        counts[int(correct), known.rows[level]] += 1.0
    shown = np.flatnonzero(counts.any(axis=0))
    log_weight = known.log_prior + counts[1, shown] @ known.log_correct[shown]
    log_weight += counts[0, shown] @ known.log_wrong[shown]
    weight = np.exp(log_weight - log_weight.max())
    return np.asarray(weight / weight.sum())


def expected_entropy(history: History, grid: Grid) -> Floats:
    """Return the entropy, in nats, that is expected after one more answer at each level (levels,).

    Raises
    ------
    StudyError
        If a level of the history is not in the grid.
    """
    weight = _posterior(history, grid)
    known = tables(grid)
    correct = known.correct @ weight
    told = entr(correct) + entr(1.0 - correct) - known.answer_entropy @ weight
    return np.asarray(entr(weight).sum() - told)


def next_level(history: History, grid: Grid) -> float:
    """Return the level to show next: the least expected entropy, of equals the lowest.

    Raises
    ------
    StudyError
        If a level of the history is not in the grid.
    """
    entropy = expected_entropy(history, grid)
    return grid.levels[int(np.argmax(entropy < entropy.min() + TIE_NATS))]


def _check_axis(axis: Axis, name: str) -> None:
    if not axis.values:
        raise StudyError(f"{name}: must hold one value or more (got none)")
    if len(axis.values) == 1 and not math.isfinite(axis.values[0]):
        raise StudyError(f"{name}: must be a finite number (got {axis.values[0]:g})")
    if len(axis.values) > 1:
        check_rising(axis.values, name)
    if not axis.weights:
        return
    if len(axis.weights) != len(axis.values):
        raise StudyError(
            f"{name}: there must be one weight for each of the {len(axis.values)} values"
            f" (got {len(axis.weights)})"
        )
    if not all(math.isfinite(weight) and weight >= 0 for weight in axis.weights):
        raise StudyError(f"{name}: weights must be finite and at least 0 (got {axis.weights})")
    if sum(axis.weights) <= 0:
        raise StudyError(f"{name}: one weight or more must be above 0 (got only zeros)")
