"""Estimates of a threshold from a rule's answers: a session does not need them, its proof does."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import entr

from protocols.adaptive.answer_history import History
from protocols.adaptive.quest_plus import PARAMETERS, Grid, posterior
from protocols.adaptive.up_down import UpDown, performance, track
from protocols.errors import StudyError


@dataclass(frozen=True)
class Marginal:
    """One parameter's posterior: mean and standard deviation, in the unit of the parameter."""

    mean: float
    sd: float


@dataclass(frozen=True)
class Estimate:
    """Estimates of each parameter from the answers.

    Attributes
    ----------
    guess, threshold, width, lapse : Marginal
    entropy_nats : float
        Of the posterior over the whole grid.
    """

    guess: Marginal
    threshold: Marginal
    width: Marginal
    lapse: Marginal
    entropy_nats: float


def of_posterior(history: History, grid: Grid) -> Estimate:
    """Return posterior means and standard deviations.

    Raises
    ------
    StudyError
        If a level of the history is not in the grid.
    """
    weight = posterior(history, grid)
    found = {}
    for axis, name in enumerate(PARAMETERS):
        values = np.asarray(getattr(grid, name).values)
        share = weight.sum(axis=tuple(other for other in range(4) if other != axis))
        if values.size == 1:  # known, whatever its share is rounded to
            found[name] = Marginal(float(values[0]), 0.0)
            continue
        mean = float(share @ values)
        found[name] = Marginal(mean, math.sqrt(float(share @ (values - mean) ** 2)))
    return Estimate(**found, entropy_nats=float(entr(weight).sum()))


@dataclass(frozen=True)
class Reversals:
    """The level at which a track hovered.

    Attributes
    ----------
    level : float or None
        Mean over the reversals used; None where there are not two of them.
    sd : float or None
        Standard deviation of their levels. Neighbours depend on each other, so this is no
        standard error.
    reversals : int
        How many there were.
    used : int
        How many of them, the last ones, are in the mean.
    performance : float
        Share of correct answers that the level stands for.
    """

    level: float | None
    sd: float | None
    reversals: int
    used: int
    performance: float


def of_reversals(history: History, settings: UpDown, *, discard: int | None = None) -> Reversals:
    """Return the mean level of the reversals.

    Parameters
    ----------
    discard : int or None
        Reversals at the start that do not count. None: those before the last step size, and
        one more. After that, one more is left out where their number is odd, so that turns
        upwards and downwards count the same (Levitt 1971).

    Raises
    ------
    StudyError
        As `track`, and if `discard` is negative.
    """
    skipped = len(settings.harder) if discard is None else discard
    if skipped < 0:
        raise StudyError(f"discard: must be at least 0 (got {skipped})")
    followed = track(history, settings)
    turns = [followed.shown[trial] for trial in followed.reversals]
    used = max(0, len(turns) - skipped) // 2 * 2
    if not used:
        return Reversals(None, None, len(turns), 0, performance(settings))
    last = turns[-used:]
    mean = math.fsum(last) / used
    sd = math.sqrt(math.fsum((level - mean) ** 2 for level in last) / (used - 1))
    return Reversals(mean, sd, len(turns), used, performance(settings))
