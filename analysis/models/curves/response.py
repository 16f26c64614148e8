"""Chance of a right answer from a linear predictor, for models of trials, and forms of curves."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, Protocol, TypeVar

import numpy as np
from scipy.special import expit, log_expit, logit, ndtr, ndtri

from analysis.arrays import Floats, Ints
from protocols.adaptive.answer_history import Shape

Link = Literal["logit", "probit", "weibull"]
Rates = tuple[float, float | Floats]
"""Guess rate, and lapse rate: one, or of each row."""

R = TypeVar("R")

LINKS: Mapping[Shape, Link] = {
    "gauss": "probit",
    "logistic": "logit",
    "gumbel": "weibull",
    "weibull": "weibull",
}
"""Link of each shape to a linear predictor: in the level, for ``weibull`` in its logarithm."""

SKEWED: tuple[Shape, ...] = ("gumbel", "weibull")
"""Shapes that are not symmetric: the falling one is 1 - S, not S turned around."""

RATE_PRIOR = (2.0, 50.0)
"""Beta law that fitted lapse and guess rates are drawn to: mode .02, 95 % below .09."""

LOG_2 = np.log(2.0)


def axis_of(level: Floats | float, logarithmic: bool) -> Floats:
    """Return levels, or their logarithms, as curves run along them."""
    level = np.asarray(level, dtype=np.float64)
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(level)) if logarithmic else level


class AnswerLaw(Protocol[R]):
    """Law of answers given a linear predictor eta and numbers that all trials share.

    Attributes
    ----------
    concave : bool
        True if the log-likelihood of eta has one hill.
    plain : bool
        True if this is an ordinary logit model.
    """

    @property
    def concave(self) -> bool: ...
    @property
    def plain(self) -> bool: ...

    def of(self, trials: Ints) -> "AnswerLaw[R]":
        """Return the law of these trials alone."""

    def rates(self, free: Floats) -> R:
        """Return the rates that trials share, from the numbers that are fitted."""

    def penalty(self, free: Floats) -> float:
        """Return the log prior of these numbers."""

    def log_likelihood(self, eta: Floats, answers: Floats, trials: Floats, rates: R) -> float:
        """Return the log-likelihood."""

    def slope(
        self, eta: Floats, answers: Floats, trials: Floats, rates: R
    ) -> tuple[Floats, Floats, Floats]:
        """Return the slope in eta, and minus the observed and the expected curvature."""


@dataclass(frozen=True)
class ResponseFunction:
    """``p = guess + (1 - guess - lapse) F(eta)``, with F(0) = 1/2.

    Attributes
    ----------
    link : {"logit", "probit", "weibull"}
        F: the logistic or the normal distribution, or 1 - 2^-exp(eta), which is Weibull's
        function of exp(eta).
    guess, lapse : float or None
        A known lapse rate may be one of each trial, ndarray (trials,). None: fitted, as the logit
        of a rate drawn towards `RATE_PRIOR` (a penalty; the prior of lapses in Broderick et al.
        2023).
    mirrored : bool
        1 - F(-eta) in place of F(eta): where a curve that is not symmetric falls with the level.
    """

    link: Link = "logit"
    guess: float | None = 0.0
    lapse: float | Floats | None = 0.0
    mirrored: bool = False

    @property
    def fitted(self) -> int:
        """Number of rates that are fitted."""
        return (self.guess is None) + (self.lapse is None)

    @property
    def concave(self) -> bool:
        """True if nobody guesses or lapses: then the log-likelihood of eta has one hill."""
        return self.guess == 0.0 and self.lapse is not None and not np.any(self.lapse)

    @property
    def plain(self) -> bool:
        """True if this is an ordinary logit model."""
        return self.link == "logit" and self.concave

    def of(self, trials: Ints) -> "ResponseFunction":
        """Return the response of these trials alone."""
        one = self.lapse is None or np.ndim(self.lapse) == 0
        return self if one else replace(self, lapse=np.asarray(self.lapse)[trials])

    def rates(self, free: Floats) -> Rates:
        """Return guess and lapse rate from the logits of those that are fitted."""
        left = list(expit(free))
        guess = self.guess if self.guess is not None else 0.5 * float(left.pop(0))
        lapse = self.lapse if self.lapse is not None else float(left.pop(0))
        return guess, lapse

    def start(self) -> Floats:
        """Return the beginning of the search for the fitted rates."""
        return np.full(self.fitted, float(logit(0.03)))

    def penalty(self, free: Floats) -> float:
        """Return the log prior of the fitted rates, on their logits."""
        a, b = RATE_PRIOR
        return float(np.sum(a * log_expit(free) + b * log_expit(-free)))

    def penalty_slope(self, free: Floats) -> Floats:
        """Return the slope of `penalty`."""
        a, b = RATE_PRIOR
        return np.asarray(a - (a + b) * expit(free))

    def share(self, eta: Floats, rates: Rates) -> Floats:
        """Return p."""
        return np.asarray(rates[0] + (1.0 - rates[0] - rates[1]) * self.rise(eta)[0])

    def eta(self, rise: float) -> float:
        """Return the place where F has this value."""
        if self.mirrored:
            return -replace(self, mirrored=False).eta(1.0 - rise)
        if self.link == "logit":
            return float(logit(rise))
        if self.link == "probit":
            return float(ndtri(rise))
        return float(np.log(-np.log1p(-rise) / LOG_2))

    def log_likelihood(self, eta: Floats, answers: Floats, trials: Floats, rates: Rates) -> float:
        """Return the log-likelihood without binomial coefficients."""
        if self.plain:
            joint = answers @ log_expit(eta) + (trials - answers) @ log_expit(-eta)
            return float(joint)
        share = self._bounded(eta, rates)
        return float(answers @ np.log(share) + (trials - answers) @ np.log1p(-share))

    def slope(
        self, eta: Floats, answers: Floats, trials: Floats, rates: Rates
    ) -> tuple[Floats, Floats, Floats]:
        """Return the slope in eta, and minus the observed and the expected curvature."""
        if self.plain:
            share = expit(eta)
            weight = trials * share * (1.0 - share)
            return answers - trials * share, weight, weight
        span = 1.0 - rates[0] - rates[1]
        _, first, second = self.rise(eta)
        share = self._bounded(eta, rates)
        first, second = span * first, span * second
        gap = (answers - trials * share) / (share * (1.0 - share))
        bend = answers / share**2 + (trials - answers) / (1.0 - share) ** 2
        expected = trials * first**2 / (share * (1.0 - share))
        return gap * first, bend * first**2 - gap * second, expected

    def _bounded(self, eta: Floats, rates: Rates) -> Floats:
        return np.clip(self.share(eta, rates), 1e-12, 1.0 - 1e-12)

    def rise(self, eta: Floats) -> tuple[Floats, Floats, Floats]:
        """Return F and its first two derivatives."""
        if self.mirrored:
            rise, first, second = replace(self, mirrored=False).rise(-eta)
            return 1.0 - rise, first, -second
        if self.link == "logit":
            rise = expit(eta)
            first = rise * (1.0 - rise)
            return rise, first, first * (1.0 - 2.0 * rise)
        if self.link == "probit":
            density = np.exp(-0.5 * eta**2) / np.sqrt(2.0 * np.pi)
            return ndtr(eta), density, -eta * density
        power = LOG_2 * np.exp(np.minimum(eta, 50.0))
        left = np.exp(-power)
        return -np.expm1(-power), power * left, power * left * (1.0 - power)


def steep_prior(beta: Floats, steepest: Floats) -> tuple[float, Floats]:
    """Return the log prior of coefficients that answers cannot tell from larger ones; its slope.

    Answers at the same few levels do not say how steep a curve is that rises between two of them:
    the prior says nothing far below `steepest` (coefficients,), and little else beyond.
    """
    part = beta / steepest
    return -0.5 * float(np.sum(part**6)), -3.0 * part**5 / steepest


LOGIT = ResponseFunction()
PROBIT = ResponseFunction("probit")


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
