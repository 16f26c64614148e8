"""Psychometric functions with guess and lapse rates, by maximum likelihood."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from analysis.arrays import Floats
from analysis.models.curves.response import Link, ResponseFunction, axis_of
from analysis.models.numeric import binomial_log_chance, chi_squared_quantile
from protocols.adaptive.answer_history import Shape
from protocols.adaptive.psychometric_function import WIDTH_EDGE
from protocols.adaptive.psychometric_function import sigmoid as broadcast_sigmoid

LINKS: Mapping[Shape, Link] = {
    "gauss": "probit",
    "logistic": "logit",
    "gumbel": "weibull",
    "weibull": "weibull",
}
"""Link of each shape to a linear predictor: in the level, for ``weibull`` in its logarithm."""

SKEWED: tuple[Shape, ...] = ("gumbel", "weibull")
"""Shapes that are not symmetric: the falling one is 1 - S, not S turned around."""

LAPSE_MAX = 0.1

LOG_MAX = 300.0
"""Largest logarithm of a width (in ranges of x), or of a threshold, that a fit may try.

Flat answers pull the width towards infinity. Far below this no answer can tell, and the exponential
stays finite."""

OPEN_RANGES = 10.0
"""A limit outside the levels shown by more than so many of their ranges is none."""

FLAT = "performance is the same at every level: no curve can be placed"

_LOW, _HIGH, _MIDDLE = (
    math.log(-math.log(1.0 - rise)) for rise in (WIDTH_EDGE, 1.0 - WIDTH_EDGE, 0.5)
)
"""Arguments at which Gumbel's function is .05, .95 and one half."""

SATURATED = 0.01
"""A level whose rise is this near 0 or 1 says nothing about the width."""


@dataclass(frozen=True)
class CurveForm:
    """Form of psychometric functions: what is known of them before they are fitted.

    Attributes
    ----------
    guess : float or None
        Known rate of guessing, such as 1/m of m alternatives, and 0 of yes-no; None fits it.
    lapse : float or None
        Known rate of lapses; None fits it.
    falling : bool
        Performance falls with the level, as with eccentricity in [BB] Fig. 17. The falling
        function of ``gumbel`` and ``weibull`` is 1 - S, as the adaptive rules have it.
    logarithmic : bool
        The curve, and what is said of thresholds and widths, are on the logarithm of the level.
    """

    guess: float | None = 0.5
    lapse: float | None = None
    shape: Shape = "gauss"
    falling: bool = False
    logarithmic: bool = False

    @property
    def response(self) -> ResponseFunction:
        """The same as a response to a linear predictor."""
        mirrored = self.falling and self.shape in SKEWED
        return ResponseFunction(LINKS[self.shape], self.guess, self.lapse, mirrored)

    def axis(self, levels: Floats, name: str = "x") -> Floats:
        """Return levels as the curve, with a response to a linear predictor, runs along them.

        Raises
        ------
        ValueError
            If the shape needs logarithms, or levels, which `name` says, have none.
        """
        if self.shape == "weibull" and not self.logarithmic:
            raise ValueError("the Weibull function needs logarithmic=True")
        if self.logarithmic and np.any(levels <= 0):
            raise ValueError(f"{name} must be positive to have a logarithm")
        return axis_of(levels, self.logarithmic)


TWO_ALTERNATIVES = CurveForm()


@dataclass(frozen=True)
class Psychometric:
    """A fitted psychometric function ``guess + (1 - guess - lapse) S(x)``.

    Attributes
    ----------
    threshold : float
        Where the sigmoid S is one half (not the proportion correct), in units of x.
    width : float
        Distance from S = .05 to S = .95; negative where performance falls with x.
    guess, lapse : float
    threshold_limits, width_limits : pair of float or None
        Profile-likelihood limits; None where the likelihood has no maximum to profile.
    deviance, df : float, int
        Against one free proportion per level.
    overdispersion : float
        Deviance per degree of freedom, at least 1: how much more answers vary than trials that
        are independent would. Limits are widened by its square root.
    warnings : tuple of str
    """

    shape: Shape
    threshold: float
    width: float
    guess: float
    lapse: float
    threshold_limits: tuple[float, float] | None
    width_limits: tuple[float, float] | None
    level: float
    log_likelihood: float
    deviance: float
    df: int
    overdispersion: float
    warnings: tuple[str, ...]
    levels: tuple[float, ...] = ()
    """Levels at which answers were given."""

    def __call__(self, x: Floats) -> Floats:
        """Return the probability of a correct answer at `x`."""
        rise = sigmoid(np.asarray(x, dtype=np.float64), self.threshold, self.width, self.shape)
        return np.asarray(self.guess + (1.0 - self.guess - self.lapse) * rise)

    @property
    def unidentified(self) -> tuple[str, ...]:
        """Fields whose numbers mean nothing."""
        unknown = self.levels and not self.identified(self.levels)
        return ("threshold", "threshold_limits", "width", "width_limits") if unknown else ()

    def identified(self, levels: Sequence[float]) -> bool:
        """Return True if answers at these levels, the ones shown, place the threshold.

        They do not where performance is flat, where the threshold lies outside the levels, or
        where a limit lies so far outside (`OPEN_RANGES`) that nothing bounds it. A
        threshold between the levels can go without limits (the lapse rate ran into its bound): it
        is placed.
        """
        low, high = min(levels), max(levels)
        if FLAT in self.warnings or not low <= self.threshold <= high:
            return False
        reach = OPEN_RANGES * (high - low)
        ends = self.threshold_limits or (self.threshold, self.threshold)
        return low - reach <= ends[0] and ends[1] <= high + reach


def sigmoid(x: Floats, threshold: float, width: float, shape: Shape) -> Floats:
    """Return S(x): one half at `threshold`, from .05 to .95 over `width`.

    A negative width gives 1 - S. ``weibull`` works on log(x), with threshold and width given on
    the axis of x (Wichmann and Hill 2001; widths as Schütt et al. 2016). The same function as
    `protocols.adaptive.psychometric_function.sigmoid`; for one threshold and width ``weibull`` is
    faster.
    """
    if width < 0 and shape in SKEWED:
        return np.asarray(1.0 - sigmoid(x, threshold, -width, shape))
    if shape != "weibull":
        return broadcast_sigmoid(x, threshold, width, shape)
    # On log x the rise from .05 to .95 spans `slope`; the width on x fixes it.
    slope = _weibull_slope(threshold, width)
    with np.errstate(divide="ignore"):
        level = slope * (np.log(np.maximum(x, 0.0)) - np.log(threshold)) + _MIDDLE
    return np.asarray(-np.expm1(-np.exp(np.minimum(level, LOG_MAX))))


def fit_psychometric(
    x: Floats,
    successes: Floats,
    trials: Floats,
    curve: CurveForm = TWO_ALTERNATIVES,
    *,
    level: float = 0.95,
) -> Psychometric:
    """Fit threshold, width, lapse (and guess) rate to counts per stimulus level.

    Parameters
    ----------
    x, successes, trials : ndarray (levels,)
    curve : CurveForm
        On x itself, also of ``weibull``. Rates are fitted within [0, .5] (guess) and [0, .1].

    Raises
    ------
    ValueError
        If arrays differ in length, fewer than two levels were shown, counts are impossible, or the
        curve is to be on logarithms.

    Notes
    -----
    Limits are wider where answers vary more than the curve and independent trials explain
    (quasi-likelihood, McCullagh and Nelder 1989; a person's attention drifts), and never narrower.
    In simulated studies of 5 to 9 levels the threshold's limits cover .95 to .98 with 20 trials a
    level and more, and .91 with 10 (.89 without).
    """
    x, successes, trials = (np.asarray(a, dtype=np.float64) for a in (x, successes, trials))
    if not (x.shape == successes.shape == trials.shape) or x.ndim != 1 or np.unique(x).size < 2:
        raise ValueError("x, successes and trials must be equally long, with two levels or more")
    if np.any(trials <= 0) or np.any(successes < 0) or np.any(successes > trials):
        raise ValueError("successes must lie between 0 and trials, and trials be positive")
    if curve.logarithmic:
        raise ValueError("curve must not be logarithmic here; give the logarithms of x")
    if curve.shape == "weibull" and np.any(x < 0):
        raise ValueError("x must not be negative for the Weibull function")
    sign = -1.0 if curve.falling else 1.0
    problem = _Problem(x, successes, trials, curve, sign)
    best, likelihood = problem.fit()
    threshold, width, guess_rate, lapse_rate = problem.unpack(best)
    share = successes / trials
    saturated = float(np.sum(binomial_log_chance(successes, trials, share)))
    constant = saturated - float(np.sum(_log_terms(successes, trials, share)))
    deviance = max(0.0, 2.0 * (saturated - constant - likelihood))
    df = x.size - best.size
    notes = _notes(problem, best, share)
    spread = max(1.0, deviance / df) if df > 0 else 1.0
    drop = 0.5 * spread * chi_squared_quantile(level)
    limits = [None if notes else problem.profile(index, best, likelihood, drop) for index in (0, 1)]
    return Psychometric(
        shape=curve.shape,
        threshold=threshold,
        width=sign * width,
        guess=guess_rate,
        lapse=lapse_rate,
        threshold_limits=limits[0],
        width_limits=_signed(limits[1], sign),
        level=level,
        log_likelihood=likelihood + constant,
        deviance=deviance,
        df=df,
        overdispersion=spread,
        warnings=notes,
        levels=tuple(map(float, np.unique(problem.x))),
    )


@dataclass(frozen=True)
class _Problem:
    """The likelihood in unbounded parameters: threshold, log width, then the fitted rates."""

    x: Floats
    successes: Floats
    trials: Floats
    curve: CurveForm
    sign: float

    def unpack(self, theta: Floats) -> tuple[float, float, float, float]:
        rates, (guess, lapse) = list(theta[2:]), (self.curve.guess, self.curve.lapse)
        guess = guess if guess is not None else 0.5 * float(np.sin(rates.pop(0)) ** 2)
        lapse = lapse if lapse is not None else LAPSE_MAX * float(np.sin(rates[0]) ** 2)
        scale = self._scale
        threshold = _exp(theta[0]) if self.curve.shape == "weibull" else theta[0] * scale
        return float(threshold), _exp(theta[1]) * scale, guess, lapse

    @cached_property
    def _scale(self) -> float:
        return float(np.ptp(self.x))

    def loss(self, theta: Floats) -> float:
        threshold, width, guess, lapse = self.unpack(theta)
        rise = sigmoid(self.x, threshold, self.sign * width, self.curve.shape)
        share = guess + (1.0 - guess - lapse) * rise
        return -float(_log_terms(self.successes, self.trials, share).sum())

    def starts(self) -> list[Floats]:
        scale, logarithmic = self._scale, self.curve.shape == "weibull"
        places = np.quantile(self.x, [0.25, 0.5, 0.75])
        rates = [0.6] * self.curve.response.fitted
        return [
            np.array(
                [
                    np.log(max(place, 1e-9 * scale)) if logarithmic else place / scale,
                    np.log(width),
                    *rates,
                ]
            )
            for place in places
            for width in (0.2, 0.6, 1.5)
        ]

    def fit(
        self, hold: tuple[int, float] | None = None, start: Floats | None = None
    ) -> tuple[Floats, float]:
        def run(theta: Floats) -> float:
            if hold is not None:  # as `np.insert`, which takes longer than the rest
                place, value = hold
                theta = np.concatenate((theta[:place], (value,), theta[place:]))
            return self.loss(theta)

        # The best few of a grid of starts, roughly; then the best of those, sharply.
        points = sorted(self.starts(), key=self.loss)[:3] if start is None else [start]
        free = [point if hold is None else np.delete(point, hold[0]) for point in points]
        if free[0].size == 0:
            return points[0], -run(free[0])
        rough = [
            scipy.optimize.minimize(
                run, point, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-5}
            )
            for point in free
        ]
        # On a profile only the height counts, and that to a thousandth of the drop.
        found = scipy.optimize.minimize(
            run,
            min(rough, key=lambda one: float(one.fun)).x,
            method="Nelder-Mead",
            options={
                "xatol": 1e-9 if hold is None else 1e-4,
                "fatol": 1e-11 if hold is None else 1e-6,
                "maxiter": 4000,
                "maxfev": 4000,
            },
        )
        best = np.asarray(found.x, dtype=np.float64)
        return (best if hold is None else np.insert(best, *hold)), -float(found.fun)

    def profile(
        self, index: int, best: Floats, likelihood: float, drop: float
    ) -> tuple[float, float]:
        """Return the values of one parameter where the profile falls by `drop`."""

        def excess(value: float) -> float:
            start = best.copy()
            start[index] = value
            return likelihood - self.fit((index, value), start)[1] - drop

        ends = []
        for direction in (-1.0, 1.0):
            reach, inner = 0.05, float(best[index])
            while excess(best[index] + direction * reach) < 0 and reach < 20:
                inner = float(best[index] + direction * reach)
                reach *= 1.7
            outer = float(best[index] + direction * reach)
            end = outer if reach >= 20 else scipy.optimize.brentq(excess, inner, outer, xtol=1e-5)
            theta = best.copy()
            theta[index] = end
            ends.append(self.unpack(theta)[index])
        return min(ends), max(ends)


def _notes(problem: _Problem, best: Floats, share: Floats) -> tuple[str, ...]:
    threshold, width, _, lapse = problem.unpack(best)
    notes = []
    rise = sigmoid(problem.x, threshold, width, problem.curve.shape)
    if np.ptp(share) == 0:
        notes.append(FLAT)
    elif np.all((rise < SATURATED) | (rise > 1.0 - SATURATED)):
        notes.append("the answers jump between two levels: the width is only bounded above")
    elif not problem.x.min() <= threshold <= problem.x.max():
        notes.append("the threshold lies outside the levels shown: it is extrapolated")
    if problem.curve.lapse is None and lapse > 0.95 * LAPSE_MAX:
        notes.append(f"the lapse rate ran into its bound of {LAPSE_MAX}")
    return tuple(notes)


def _exp(value: float) -> float:
    return float(np.exp(min(max(value, -LOG_MAX), LOG_MAX)))


def _log_terms(successes: Floats, trials: Floats, share: Floats) -> Floats:
    share = np.minimum(np.maximum(share, 1e-12), 1.0 - 1e-12)  # `np.clip` takes twice as long
    return np.asarray(successes * np.log(share) + (trials - successes) * np.log1p(-share))


def _signed(limits: tuple[float, float] | None, sign: float) -> tuple[float, float] | None:
    if limits is None or sign > 0:
        return limits
    return -limits[1], -limits[0]


def _weibull_slope(threshold: float, width: float) -> float:
    """Return the slope on log x for which x(.95) - x(.05) equals `width`."""
    low, high = _LOW - _MIDDLE, _HIGH - _MIDDLE

    def gap(log_slope: float) -> float:
        slope = math.exp(log_slope)
        return threshold * (math.exp(high / slope) - math.exp(low / slope)) - width

    lower, upper = math.log(0.02), math.log(1e4)
    if gap(lower) < 0:
        return 0.02
    if gap(upper) > 0:
        return 1e4
    return math.exp(scipy.optimize.brentq(gap, lower, upper, xtol=1e-12))
