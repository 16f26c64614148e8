"""Curves of a population: what follows from the parameters of one model, by the delta method."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import expit, ndtr, ndtri

from analysis.arrays import Floats
from analysis.models.contrasts import CrossedDesign, Difference, Pair, wald
from analysis.models.curves.quadrature import mean_lapse
from analysis.models.curves.response import ResponseFunction, axis_of
from analysis.models.numeric import delta_method, two_sided_quantile
from protocols.adaptive.psychometric_function import WIDTH_EDGE

OPEN_RANGES = 5.0
"""A limit outside the levels shown by more than so many of their ranges bounds nothing."""

_NODES = np.linspace(-4.5, 4.5, 91)
_WEIGHTS = np.exp(-0.5 * _NODES**2) / np.exp(-0.5 * _NODES**2).sum()
"""Nodes and weights of a standard normal."""


@dataclass(frozen=True)
class Threshold:
    """One condition's threshold in the population, and the width of its curve.

    `value` is where the rise from guessing to lapsing is half done, in units of the level.
    `width` is the distance from 5 to 95 % of the rise (a ratio where levels are logarithmic);
    negative where performance falls with the level. `individual` holds each participant's own,
    drawn towards the mean. Where the answers do not place the threshold, value and width are NaN,
    limits None, and `individual` is empty.
    """

    condition: str
    value: float
    lower: float | None
    upper: float | None
    width: float
    individual: Mapping[str, float]

    def identified(self, levels: Sequence[float] = ()) -> bool:
        """Return True if the answers place it: with limits, not far outside the levels shown.

        Far is further than the levels' range; of its limits, than `OPEN_RANGES` of these.
        """
        if self.lower is None or self.upper is None:
            return False
        if not levels:
            return True
        low, high = min(levels), max(levels)
        reach = OPEN_RANGES * (high - low)
        bounded = low - reach <= self.lower and self.upper <= high + reach
        return bounded and 2.0 * low - high <= self.value <= 2.0 * high - low


@dataclass(frozen=True)
class Population:
    """Parameters of the curves of all conditions, and how well they are known.

    Attributes
    ----------
    names, pairs
        Conditions, and which are compared.
    theta, covariance : ndarray (parameters,), (parameters, parameters)
        Intercepts of eta by condition; the slope of all; deviations; then what the fitted rates
        are made of (`quadrature.PeopleFit.rates`).
    kinds : tuple of str
        Names of the deviations: of participants, of these in one condition, and both of scenes.
    centre, spread : float
        eta is linear in (x - centre) / spread; x is the level, or its logarithm.
    response : ResponseFunction
    own : mapping of condition to (mapping of participant to deviation of eta)
    levels : tuple of float
        Shown.
    level : float
        Coverage of limits.
    proper : bool
        Whether the likelihood has a maximum; else nothing has limits.
    """

    names: tuple[str, ...]
    pairs: tuple[Pair, ...]
    theta: Floats
    covariance: Floats
    kinds: tuple[str, ...]
    centre: float
    spread: float
    logarithmic: bool
    response: ResponseFunction
    own: Mapping[str, Mapping[str, float]]
    crossed: CrossedDesign
    levels: tuple[float, ...]
    level: float
    proper: bool

    def rates(self, theta: Floats | None = None) -> tuple[float, float]:
        """Return the guess rate, and the mean lapse rate of the population."""
        free = self._split(self.theta if theta is None else theta)[1]
        lapse = self.response.lapse
        guess = self.response.guess
        if guess is None:
            guess = 0.5 * float(expit(free[0]))
        return guess, mean_lapse(*free[-2:]) if lapse is None else float(np.mean(lapse))

    @property
    def sd(self) -> dict[str, float]:
        """Deviations of eta by name."""
        return dict(zip(self.kinds, self._split(self.theta)[0].tolist(), strict=True))

    def drawn_lapses(self, people: tuple[int, ...], rng: np.random.Generator) -> Floats:
        """Return lapse rates of so many people of this population."""
        if self.response.lapse is not None:
            return np.full(people, self.rates()[1])
        middle, sd = self._split(self.theta)[1][-2:]
        return np.asarray(expit(middle + sd * rng.standard_normal(people)))

    def eta(self, condition: str, x: Floats) -> Floats:
        """Return eta of the typical participant at levels `x`."""
        return self._eta(self.theta, condition, x)

    def _split(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return deviations, and what the fitted rates are made of."""
        first = len(self.names) + 1
        return theta[first : first + len(self.kinds)], theta[first + len(self.kinds) :]

    def _slope(self, theta: Floats) -> float:
        return float(theta[len(self.names)])

    def _places(self, theta: Floats) -> Floats:
        """Return the typical participant's thresholds along the axis of the fit (names,)."""
        gap = self.response.eta(0.5) - theta[: len(self.names)]
        return np.asarray(self.centre + self.spread * gap / self._slope(theta))

    def places(self) -> Floats:
        """Return thresholds along the axis of the fit (names,): logarithms where it has these."""
        return self._places(self.theta)

    def thresholds(self) -> tuple[tuple[Threshold, ...], tuple[Difference, ...]]:
        """Return the typical participant's thresholds, and those that are placed compared."""
        place, covariance = delta_method(self._places, self.theta, self.covariance)
        reach = self._quantiles(covariance) * _errors(covariance)
        slope = self._slope(self.theta)
        width = span(self.response) * self.spread / slope
        if self.logarithmic:
            width = float(np.sign(width) * _risen(np.abs(width)))
        back = _risen if self.logarithmic else np.asarray
        found = []
        for k, name in enumerate(self.names):
            one = Threshold(
                condition=name,
                value=float(back(place[k])),
                lower=float(back(place[k] - reach[k])) if self.proper else None,
                upper=float(back(place[k] + reach[k])) if self.proper else None,
                width=width,
                individual={
                    who: float(back(place[k] - self.spread * apart / slope))
                    for who, apart in self.own[name].items()
                },
            )
            placed = one.identified(self.levels)
            found.append(one if placed else Threshold(name, np.nan, None, None, np.nan, {}))
        known = {one.condition for one in found if not np.isnan(one.value)}
        measure = "ln threshold" if self.logarithmic else "threshold"
        pairs = [pair for pair in self.pairs if {*pair} <= known]
        several = wald(
            measure, self.names, pairs, place, covariance, crossed=self.crossed, level=self.level
        )
        return tuple(found), tuple(several)

    def average(self, condition: str, x: Floats) -> Floats:
        """Return the population's mean share of right answers at `x`.

        This is what all answers together follow: it rises less steeply than the typical one's.
        """
        return self._average(self.theta, condition, x)

    def average_limits(self, condition: str, x: Floats) -> tuple[Floats, Floats]:
        """Return limits of `average` at each of `x`, by the delta method on normal quantiles."""
        floor = self.response.guess or 0.0
        value, covariance = delta_method(
            lambda theta: ndtri((self._average(theta, condition, x) - floor) / (1.0 - floor)),
            self.theta,
            self.covariance,
        )
        places = delta_method(self._places, self.theta, self.covariance)
        reach = self._quantiles(places[1])[self.names.index(condition)] * _errors(covariance)
        lower, upper = (floor + (1.0 - floor) * ndtr(end) for end in (value - reach, value + reach))
        return np.asarray(lower), np.asarray(upper)

    def typical(self, condition: str, x: Floats, who: str | None = None) -> Floats:
        """Return the chance of a right answer of the typical participant, or of one, at `x`."""
        apart = 0.0 if who is None else self.own[condition][who]
        rise = self.response.rise(self._eta(self.theta, condition, x) + apart)[0]
        guess, lapse = self.rates()
        return np.asarray(guess + (1.0 - guess - lapse) * rise)

    def _average(self, theta: Floats, condition: str, x: Floats) -> Floats:
        sd = float(np.linalg.norm(self._split(theta)[0]))
        eta = self._eta(theta, condition, x)[:, None] + sd * _NODES
        guess, lapse = self.rates(theta)
        share = guess + (1.0 - guess - lapse) * (self.response.rise(eta)[0] @ _WEIGHTS)
        return np.asarray(np.clip(share, guess + 1e-9, 1.0 - 1e-9))

    def _eta(self, theta: Floats, condition: str, x: Floats) -> Floats:
        k = self.names.index(condition)
        along = (axis_of(x, self.logarithmic) - self.centre) / self.spread
        return np.asarray(theta[k] + self._slope(theta) * along)

    def _quantiles(self, covariance: Floats) -> Floats:
        """Return quantiles of t that limits of thresholds with this covariance reach (names,)."""
        variance = np.diag(covariance).clip(min=0)
        units = np.eye(len(self.names))
        df = [self.crossed.df(unit, float(own)) for unit, own in zip(units, variance, strict=True)]
        return two_sided_quantile(self.level, df)


def span(response: ResponseFunction) -> float:
    """Return the distance in eta over which F rises from 5 to 95 %."""
    return response.eta(1.0 - WIDTH_EDGE) - response.eta(WIDTH_EDGE)


def _errors(covariance: Floats) -> Floats:
    return np.asarray(np.sqrt(np.diag(covariance).clip(min=0)))


def _risen(logarithm: Floats) -> Floats:
    """Return the level of a logarithm; one too far out to be a number is infinite."""
    with np.errstate(over="ignore"):
        return np.asarray(np.exp(logarithm))
