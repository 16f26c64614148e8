"""Profile likelihoods: maxima with a number held, and tests and limits that follow from them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy

from analysis.arrays import Floats
from analysis.models.mixed.inference import cut_of_draws, p_of_draws
from analysis.models.numeric import two_sided_p, two_sided_quantile

MOST_STEPS, MOST_HALVES = 20, 4
SMALL_GAIN = 1e-5
"""Gain of a log likelihood by a further step that is not taken; it is added."""
LEAST_START_SD = 0.1
"""Least deviation where a search begins: at 0 a likelihood is level in it."""
ONE_MAXIMUM = 1e-4
"""Maxima of a log likelihood that differ by less are one."""

_LONGEST = 30
_NEAR_ENOUGH = 1e-4
_FARTHEST = 10.0
_NARROW = 1e-6
"""Steps in search of a limit, and the share of the way that may be left; in distances to where it
begins, how far to go, beyond which there is none, and the least step."""
_NEAR = 2.0
"""Ratio of two distances up to which one is a place to begin in search of the other."""


def profile_end(beyond: Callable[[float], float], value: float, first: float) -> float:
    """Return the place at which a likelihood has fallen by what `beyond` allows, or infinity.

    Parameters
    ----------
    beyond : callable
        Root of the likelihood ratio at a place, less that at a limit: below 0 at `value`.
    value, first : float
        Where the likelihood is largest, and where the search begins, on the side searched.
    """
    cut = -beyond(value)
    inside, outside, last = (value, -cut), (math.inf, math.inf), (value, -cut)
    at = first
    for _ in range(_LONGEST):
        now = at, beyond(at)
        # 0 is no limit unless it is one to the last digit: p tells on which side it lies.
        if at != 0.0 and abs(now[1]) < _NEAR_ENOUGH * cut:
            break
        if now[1] < 0.0:
            inside = now
        else:
            outside = now
        # Where one maximum takes over from another the root leaps, and nothing lies near enough.
        if abs(now[0] - last[0]) <= _NARROW * abs(first - value):
            break
        # The root is nearly straight: the next place is on the line through the last two.
        rise = (now[1] - last[1]) / (now[0] - last[0])
        at = now[0] - now[1] / rise if rise else math.inf
        if math.isinf(outside[0]):
            share = (at - value) / (now[0] - value)
            at = value + (min(share, 3.0) if share > 1.0 else 3.0) * (now[0] - value)
            if abs(at - value) > _FARTHEST * abs(first - value):
                return math.copysign(math.inf, first - value)
        elif not 0.01 < (at - inside[0]) / (outside[0] - inside[0]) < 0.99:
            share = min(max(-inside[1] / (outside[1] - inside[1]), 0.1), 0.9)
            at = inside[0] + share * (outside[0] - inside[0])
        last = now
    return at


@dataclass(frozen=True)
class RatioTest:
    """Judgement of a contrast by its likelihood ratio, and limits that leave out 0 where p does.

    `root` is that of the ratio at 0, with the sign of the contrast; p is of t, or by bootstrap.
    """

    root: float
    p: float
    lower: float
    upper: float


def ratio_test(
    log_likelihood: Callable[[float], float],
    best: float,
    value: float,
    error: float,
    df: float,
    level: float,
    drawn: Floats | None = None,
) -> RatioTest:
    """Judge a contrast by the likelihood ratio against 0.

    Parameters
    ----------
    log_likelihood : callable
        From a value of the contrast, held there, to the maximum over all else.
    best, value, error : float
        The maximum where it is free, where that is, and about its standard error.
    df : float
        Of t, by which the root of the ratio is judged.
    drawn : ndarray, optional
        Ratios of studies drawn from the model where the contrast is 0; they take the place of t.
        Where they are too few to show a p below 1 - level, limits are NaN.
    """

    @cache  # a search for a root asks for both ends again
    def ratio(held: float) -> float:
        return 0.0 if held == value else max(2.0 * (best - log_likelihood(held)), 0.0)

    observed = ratio(0.0)
    root = math.copysign(math.sqrt(observed), value)
    if drawn is None:
        p, cut = float(two_sided_p(abs(root), df)), float(two_sided_quantile(level, df))
    else:
        p, cut = p_of_draws(observed, drawn), math.sqrt(cut_of_draws(drawn, level))
        if math.isnan(cut):
            return RatioTest(root, p, math.nan, math.nan)

    def end(side: float) -> float:
        reach = side * cut * error
        # Near a limit, 0 itself is an end of the search: what is found lies where p says.
        near = 1.0 / _NEAR < -value / reach < _NEAR
        first = 0.0 if near else value + reach
        return profile_end(lambda held: math.sqrt(ratio(held)) - cut, value, first)

    return RatioTest(root, p, end(-1.0), end(1.0))


@dataclass(frozen=True)
class Maximum:
    """A likelihood where it is largest, and what a profile of it needs.

    Attributes
    ----------
    cost : callable
        Minus the log likelihood, and its slope, in all parameters.
    point, covariance : ndarray (parameters,), (parameters, parameters)
    deviations : range
        Places of the deviations of random effects among the parameters.
    """

    cost: Callable[[Floats], tuple[float, Floats]]
    point: Floats
    covariance: Floats
    deviations: range

    @property
    def log_likelihood(self) -> float:
        """The log likelihood there."""
        return -self.cost(self.point)[0]


class HeldContrast:
    """Maximum of a likelihood where a contrast of its parameters is held, value after value.

    Where the contrast is not what fits best, one random effect or another may take it over, and
    the likelihood may have a maximum for each. All are followed from one value to the next.

    Parameters
    ----------
    weights : ndarray (up to parameters,)
        Of the first parameters; the rest are 0.
    """

    def __init__(self, maximum: Maximum, weights: Floats) -> None:
        self.maximum = maximum
        self.along = np.append(weights, np.zeros(maximum.point.size - weights.size))
        self.value = float(self.along @ maximum.point)
        self._maxima: dict[bool, list[Floats]] = {}

    def __call__(self, value: float) -> float:
        return self.at(value)[0]

    def at(self, value: float) -> tuple[float, Floats]:
        """Return the log likelihood where the contrast has this value, and its parameters."""
        own, side = self.maximum, value > self.value
        begins = self._maxima.get(side)
        if not begins:
            sds = own.point[own.deviations.start : own.deviations.stop]
            missing = (value - self.value) / np.abs(self.along).max()
            begins = []
            for sd in absorbing(sds, missing, range(sds.size)):
                begins.append(own.point.copy())
                begins[-1][own.deviations] = sd
        tried = [
            held_maximum(own.cost, begin, own.covariance, self.along, value) for begin in begins
        ]
        tried.sort(key=lambda one: -one[0])
        self._maxima[side] = [
            point
            for k, (found, point) in enumerate(tried)
            if k == 0 or tried[k - 1][0] - found > ONE_MAXIMUM
        ]
        return tried[0]

    def ratio(self) -> tuple[float, Floats]:
        """Return the likelihood ratio against 0, and the parameters there."""
        found, point = self.at(0.0)
        return max(2.0 * (self.maximum.log_likelihood - found), 0.0), point


def absorbing(sd: Floats, missing: float, effects: Sequence[int]) -> list[Floats]:
    """Return deviations where searches without a contrast begin: an effect in turn takes it over.

    What all people have in common looks without it like a deviation of people, or of scenes, and
    the likelihood may have a maximum for each.
    """
    least = np.maximum(np.abs(sd), LEAST_START_SD)
    begins = [least.copy() for _ in effects]
    for begin, effect in zip(begins, effects, strict=True):
        begin[effect] = math.hypot(begin[effect], missing)
    return begins or [least]


def held_maximum(
    cost: Callable[[Floats], tuple[float, Floats]],
    begin: Floats,
    covariance: Floats,
    along: Floats,
    value: float,
) -> tuple[float, Floats]:
    """Return the maximum of a log likelihood with a contrast of parameters held, and its place.

    Parameters
    ----------
    cost : callable
        Minus the log likelihood, and its slope.
    begin : ndarray (parameters,)
        A maximum near, from which the search begins.
    covariance : ndarray (parameters, parameters)
        Where all are free; it says which way the search goes.
    along : ndarray (parameters,)
        Weights of the contrast.
    """
    place = int(np.argmax(np.abs(along)))
    keep = np.arange(begin.size) != place
    turned = -along[keep] / along[place]
    moved = covariance @ along
    own = float(along @ moved)
    rough = np.diag(np.full(begin.size, 0.02))
    if own > 1e-10:
        moved = moved / own
        rough = covariance - own * np.outer(moved, moved)
    else:
        moved = np.zeros(begin.size)
    inverse = rough[np.ix_(keep, keep)] + 1e-4 * np.eye(begin.size - 1)

    def whole(rest: Floats) -> Floats:
        return np.insert(rest, place, value / along[place] + float(turned @ rest))

    def free(rest: Floats) -> tuple[float, Floats]:
        found, slope = cost(whole(rest))
        return found, slope[keep] + slope[place] * turned

    at = (begin + moved * (value - float(along @ begin)))[keep]
    inverse = 0.5 * (inverse + inverse.T)
    now, slope = free(at)
    for _ in range(MOST_STEPS):
        step = inverse @ slope
        gain = 0.5 * float(slope @ step)
        if gain < SMALL_GAIN:
            return gain - now, whole(at)
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
        curved = float(step @ bend)
        if curved > 0.0:
            turn = np.eye(step.size) - np.outer(step, bend) / curved
            inverse = turn @ inverse @ turn.T + np.outer(step, step) / curved
        at, now, slope = at - step, new, new_slope
    found = scipy.optimize.minimize(free, at, jac=True, method="BFGS", options={"gtol": 1e-3})
    return -float(found.fun), whole(np.asarray(found.x, dtype=np.float64))
