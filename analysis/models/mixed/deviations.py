"""Standard deviations of random effects: profile limits and shares of variance."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
import scipy

from analysis.arrays import Floats
from analysis.models.numeric import chi_squared_quantile

MOST_PROFILED = 300
"""Effects together, at most, that get profile limits: more take minutes."""
LATENT_VARIANCE = {"logit": math.pi**2 / 3.0, "probit": 1.0}
"""Variance of one answer on the scale of the model, by link."""
MOST_STEPS, MOST_HALVES = 20, 4
SMALL_GAIN = 1e-3
"""Gain of a log likelihood by a further step that is not taken; it is added."""
_LONGEST = 20
"""Doublings of the step in search of an upper limit."""


@dataclass(frozen=True)
class Deviation:
    """The standard deviation of one random effect.

    Attributes
    ----------
    lower, upper : float
        Of the profile likelihood; NaN where they were not searched, infinite without an end.
    icc : float
        Share of the variance of one answer on the model's scale (intraclass correlation); NaN of
        slopes.
    """

    name: str
    sd: float
    lower: float
    upper: float
    icc: float


def profile_limits(
    log_likelihood: Callable[[float], float], sd: float, best: float, error: float, level: float
) -> tuple[float, float]:
    """Return the places at which a profile likelihood falls by half the quantile of chi-square (1).

    Parameters
    ----------
    log_likelihood : callable
        From the deviation, at least 0, to the maximum over all else.
    sd, best : float
        Where it is largest, and how large.
    error : float
        About the standard error of `sd`: of the first step.
    """
    cut = math.sqrt(chi_squared_quantile(level))

    @cache  # a search for a root asks for both ends again
    def beyond(value: float) -> float:
        if value == sd:
            return -cut
        return math.sqrt(max(2.0 * (best - log_likelihood(value)), 0.0)) - cut

    step = error if math.isfinite(error) and error > 0.0 else max(sd, 0.1)
    how = {"xtol": 1e-3 * max(sd, step), "rtol": 1e-4}
    lower = 0.0
    if sd > 0.0 and beyond(0.0) > 0.0:
        lower = float(scipy.optimize.brentq(beyond, 0.0, sd, **how))
    low, high = sd, sd + 2.0 * step
    for _ in range(_LONGEST):
        if beyond(high) > 0.0:
            return lower, float(scipy.optimize.brentq(beyond, low, high, **how))
        low, high, step = high, high + 2.0 * step, 2.0 * step
    return lower, math.inf


def held_maximum(
    cost: Callable[[Floats], tuple[float, Floats]],
    point: Floats,
    covariance: Floats,
    place: int,
    value: float,
) -> float:
    """Return the maximum of a log likelihood, minus `cost`, with one parameter held.

    Parameters
    ----------
    cost : callable
        Minus the log likelihood, and its slope.
    point, covariance : ndarray (parameters,), (parameters, parameters)
        Where all are free; it says where the search begins and which way it goes.
    """
    keep = np.arange(point.size) != place
    own = float(covariance[place, place])
    moved, rough = np.zeros(point.size), np.diag(np.full(point.size, 0.02))
    if own > 1e-10:
        moved = covariance[:, place] / own
        rough = covariance - np.outer(moved, covariance[place])
    inverse = rough[np.ix_(keep, keep)] + 1e-4 * np.eye(point.size - 1)

    def free(rest: Floats) -> tuple[float, Floats]:
        whole = np.insert(rest, place, value)
        found, slope = cost(whole)
        return found, slope[keep]

    at = (point + moved * (value - point[place]))[keep]
    inverse = 0.5 * (inverse + inverse.T)
    now, slope = free(at)
    for _ in range(MOST_STEPS):
        step = inverse @ slope
        gain = 0.5 * float(slope @ step)
        if gain < SMALL_GAIN:
            return gain - now
        for _ in range(MOST_HALVES):
            with np.errstate(all="ignore"):  # a step may lead out of what a model can be
                new, new_slope = free(at - step)
            if new < now:
                break
            step = 0.25 * step
        else:
            break
        # The inverse second derivative learns from each step (BFGS).
        bend = slope - new_slope
        along = float(step @ bend)
        if along > 0.0:
            turn = np.eye(step.size) - np.outer(step, bend) / along
            inverse = turn @ inverse @ turn.T + np.outer(step, step) / along
        at, now, slope = at - step, new, new_slope
    found = scipy.optimize.minimize(free, at, jac=True, method="BFGS", options={"gtol": 1e-3})
    return -float(found.fun)


@dataclass(frozen=True)
class FittedEffects:
    """Random effects of a fitted model, of whichever kind.

    Attributes
    ----------
    sd, errors
        By name of the effect, and about the standard errors of these.
    held : callable
        From the number of an effect and its deviation, held there, to the maximum over all else;
        `best` where none is held.
    effects : int
        Number of their levels together.
    rest : float
        Variance of one answer. `slopes` name the deviations that have no share of it: where what
        they multiply is at its middle they are 0.
    """

    sd: Mapping[str, float]
    errors: Floats
    held: Callable[[int, float], float]
    best: float
    effects: int
    rest: float
    slopes: Sequence[str] = ()

    def deviations(self, level: float) -> tuple[Deviation, ...]:
        """Return deviations with profile limits, and their shares of the variance.

        Of more than `MOST_PROFILED` levels limits are not had.
        """
        total = self.rest + sum(own**2 for name, own in self.sd.items() if name not in self.slopes)
        found = []
        for number, (name, own) in enumerate(self.sd.items()):
            ends: tuple[float, float] = math.nan, math.nan
            if self.effects <= MOST_PROFILED:
                held, error = partial(self.held, number), float(self.errors[number])
                ends = profile_limits(held, own, self.best, error, level)
            icc = math.nan if name in self.slopes else own**2 / total
            found.append(Deviation(name, own, *ends, icc))
        return tuple(found)
