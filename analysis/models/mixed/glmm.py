"""Models of trials with crossed random effects, fitted by the Laplace approximation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.special import expit

from analysis.arrays import Floats, Ints
from analysis.models.curves.response import LOGIT, AnswerLaw, R, ResponseFunction, steep_prior
from analysis.models.mixed.arrow_matrix import Arrow, N, RandomEffects
from analysis.models.mixed.deviations import LATENT_VARIANCE, Deviation, FittedEffects
from analysis.models.mixed.logit import fit_logit
from analysis.models.mixed.profile import Maximum, held_maximum
from analysis.models.numeric import newton_polish

START_SD = 0.5

LARGEST_SD = 8.0
"""Logits; a fit beyond has run away."""

SINGULAR_SD = 1e-3
"""Logits; no data could tell a deviation below from 0."""

ROUGH_VARIANCE = 0.02
"""Variance of a deviation: about that of ten people's."""
ROUGH_RIDGE = 0.1
"""On the information about coefficients, so that a first step stays short."""

MOST_STEPS = 100
LONGEST_STEP = 3.0
SMALL_STEP = 1e-6
"""Least step of the search for the mode, in deviations of an effect; its square is left."""
BEND_STEP = 1e-4
RATE_STEP = 1e-4
"""Steps of differences: of a curvature in eta, of the likelihood in the logit of a rate."""


@dataclass(frozen=True)
class CrossedFit:
    """Fixed effects, their standard errors, and the deviation of each random effect.

    `covariance` is of beta, then sd, then the logits of fitted rates. `random` holds the mode of
    each factor's effects, in units of eta. `converged` is False where the likelihood has no
    proper maximum: deviations run off to infinity when nearly everyone always answers alike.
    """

    beta: Floats
    beta_se: Floats
    sd: Floats
    log_likelihood: float
    converged: bool
    covariance: Floats
    guess: float
    lapse: float
    random: tuple[Floats, ...]
    response: ResponseFunction = field(repr=False)
    maximum: Maximum = field(repr=False)


@dataclass(frozen=True)
class CountedTrials:
    """Trials that share everything as one row: same likelihood, less work.

    Attributes
    ----------
    first : ndarray (rows,)
        A trial of each row.
    trials, answers : ndarray (rows,)
        How many, and how many of them are 1; of ordered answers the one that all of them are.
    """

    first: Ints
    trials: Floats
    answers: Floats
    effects: RandomEffects

    @classmethod
    def of(
        cls,
        design: Floats,
        y: NDArray[N],
        groups: Sequence[Ints],
        slopes: Sequence[Floats | None] = (),
        *,
        ordered: bool = False,
    ) -> "CountedTrials":
        """Count trials; arguments as of `fit_crossed`. `ordered`: `y` are categories."""
        given = [*slopes, *([None] * (len(groups) - len(slopes)))]
        codes = [code.reshape(len(code), -1) for code in groups]
        times = [
            np.ones(code.shape) if values is None else values.reshape(code.shape)
            for code, values in zip(codes, given, strict=True)
        ]
        key = np.column_stack([design, *codes, *times, *([y] if ordered else [])])
        _, first, row = np.unique(key, axis=0, return_index=True, return_inverse=True)
        row = row.ravel()
        counted = np.bincount(row, weights=y).astype(np.float64)
        effects = RandomEffects([c[first] for c in codes], [t[first] for t in times], first.size)
        return cls(
            first=first,
            trials=np.bincount(row).astype(np.float64),
            answers=np.asarray(y[first], dtype=np.float64) if ordered else counted,
            effects=effects,
        )


def fit_crossed(
    design: Floats,
    y: Floats,
    groups: Sequence[Ints],
    *,
    response: ResponseFunction = LOGIT,
    slopes: Sequence[Floats | None] = (),
    start: Floats | None = None,
    steepest: Floats | None = None,
) -> CrossedFit:
    """Maximise the Laplace likelihood of a model of trials with crossed random effects.

    Parameters
    ----------
    design : ndarray (trials, coefficients)
    y : ndarray (trials,)
        0 or 1.
    groups : sequence of ndarray (trials,) or (trials, members)
        Level of each random factor, counted from 0; several where a trial has several effects
        of one factor, such as those of the two methods it compares.
    response : ResponseFunction
        How eta becomes the chance of a 1; a fitted lapse or guess rate is one more parameter.
    slopes : sequence of ndarray like `groups`, or None
        What each factor's effect is multiplied by; None, or left out: 1, a random intercept.
    start : ndarray (coefficients,) or of all parameters, optional
        Where the search begins; left out, at the coefficients of the logit model.
    steepest : ndarray (coefficients,), optional
        As of `quadrature.fit_people`.

    Notes
    -----
    eta = X beta + sum_k sd_k z_k b_k, b standard normal. For given (beta, sd) the mode of b is
    found by Newton steps; the Laplace likelihood is -h(mode) - log det H / 2, with h the joint
    negative log density and H its second derivative in b. The outer search runs over beta and sd
    (not its logarithm: at sd 0 the likelihood is even in sd, so a boundary fit keeps a proper
    second derivative). Its slope is exact, with the mode moving along (Kristensen et al. 2016,
    section 2). Standard errors invert the second derivative in all parameters. Where people guess
    or lapse the log-likelihood of eta is no single hill, and H is the expected second derivative,
    as in lme4.
    """
    counted = CountedTrials.of(design, y, groups, slopes)
    model = LaplaceLikelihood(design, counted, response, steepest)
    coefficients, factors = design.shape[1], len(groups)
    if start is None:
        first = fit_logit(model.design, model.answers, model.trials).beta
        start = np.concatenate([first, np.full(factors, START_SD), response.start()])
    elif start.size == coefficients:
        start = np.concatenate([start, np.full(factors, START_SD), response.start()])
    point, hessian = newton_polish(model, _found(model, start, model.rough_covariance(start)))
    sd = np.abs(point[coefficients : coefficients + factors])
    proper = bool(np.all(np.isfinite(hessian))) and float(sd.max(initial=0.0)) < LARGEST_SD
    proper = proper and bool(np.linalg.eigvalsh(hessian)[0] > 1e-8)
    covariance = np.eye(point.size)
    if proper:
        covariance = np.asarray(np.linalg.pinv(hessian, hermitian=True), dtype=np.float64)
    likelihood = -model(point)[0]
    guess, lapse = response.rates(point[coefficients + factors :])
    lapse = float(np.mean(lapse))
    return CrossedFit(
        beta=point[:coefficients],
        beta_se=np.sqrt(np.diag(covariance)[:coefficients].clip(min=0.0)),
        sd=sd,
        log_likelihood=likelihood,
        converged=proper,
        covariance=covariance,
        guess=guess,
        lapse=lapse,
        random=model.effects.by_factor(model.effects.scale(sd) * model.mode),
        response=response,
        maximum=Maximum(model, point, covariance, range(coefficients, coefficients + factors)),
    )


def crossed_deviations(
    fit: CrossedFit, names: Sequence[str], *, slopes: Sequence[str] = (), level: float = 0.95
) -> tuple[Deviation, ...]:
    """Return the deviations of a fit with profile limits and shares of variance.

    Parameters
    ----------
    names : sequence of str
        Of its random effects; `slopes` are those that are no intercepts.
    """
    sds = dict(zip(names, fit.sd.tolist(), strict=True))
    link = fit.response.link
    effects = sum(own.size for own in fit.random)
    return laplace_deviations(fit.maximum, sds, effects, link=link, slopes=slopes, level=level)


def laplace_deviations(
    maximum: Maximum,
    sds: Mapping[str, float],
    effects: int,
    *,
    link: str,
    slopes: Sequence[str] = (),
    level: float,
) -> tuple[Deviation, ...]:
    """Return the deviations of `crossed_deviations`, of any law of answers.

    Parameters
    ----------
    sds : mapping of name to deviation
    effects : int
        Number of their levels together.
    link : key of `LATENT_VARIANCE`
    """
    errors = np.sqrt(np.diag(maximum.covariance).clip(min=0.0))
    units = np.eye(errors.size)[maximum.deviations]

    def held(number: int, sd: float) -> float:
        return held_maximum(maximum.cost, maximum.point, maximum.covariance, units[number], sd)[0]

    return FittedEffects(
        sd=sds,
        errors=errors[maximum.deviations],
        held=held,
        best=maximum.log_likelihood,
        effects=effects,
        rest=LATENT_VARIANCE[link],
        slopes=slopes,
    ).deviations(level)


def _found(model: "LaplaceLikelihood[Any]", start: Floats, rough: Floats) -> Floats:
    """Return the parameters of a maximum; `rough` is about their covariance, for the first step."""
    options = {"gtol": 1e-3, "hess_inv0": rough}
    found = scipy.optimize.minimize(model, start, jac=True, method="BFGS", options=options)
    return np.asarray(found.x, dtype=np.float64)


class LaplaceLikelihood(Generic[R]):
    """Minus the Laplace likelihood and its slope, as a function of all parameters.

    These are the coefficients, the deviations, and the free numbers of the law of answers. It
    remembers the last mode of the random effects, where the next search begins.
    """

    def __init__(
        self,
        design: Floats,
        counted: CountedTrials,
        response: AnswerLaw[R],
        steepest: Floats | None = None,
    ) -> None:
        self.design = np.asarray(design[counted.first], dtype=np.float64)
        self.trials, self.answers = counted.trials, counted.answers
        self.effects = counted.effects
        self.response = response.of(counted.first)
        self.steepest = np.full(design.shape[1], np.inf) if steepest is None else steepest
        self.mode = np.zeros(self.effects.size)
        self._ends = np.cumsum([design.shape[1], self.effects.factors])

    def __call__(self, theta: Floats) -> tuple[float, Floats]:
        at = self.solved(theta)
        return at.value, self._slope(theta, at)

    def rough_covariance(self, theta: Floats) -> Floats:
        """Return about the covariance of the parameters, for the first step of the search."""
        eta = self.design @ theta[: self.design.shape[1]]
        rates = self.response.rates(theta[self._ends[1] :])
        weight = self.response.slope(eta, self.answers, self.trials, rates)[2]
        found = np.diag(np.full(theta.size, ROUGH_VARIANCE))
        information = (self.design.T * weight) @ self.design
        fixed = np.linalg.inv(information + ROUGH_RIDGE * np.eye(len(information)))
        found[: len(fixed), : len(fixed)] = 0.5 * (fixed + fixed.T)
        return found

    def solved(self, theta: Floats) -> "_Mode[R]":
        """Return the mode of the random effects, by Newton steps, and what holds there."""
        beta, sd, free = np.split(theta, self._ends)
        fixed, rates = self.design @ beta, self.response.rates(free)
        scale = self.effects.scale(np.abs(sd))
        b, step, promised, done = self.mode, np.zeros(self.effects.size), 0.0, False
        for _ in range(MOST_STEPS):
            eta = fixed + self.effects.on_trials(scale * b)
            gap, weight, expected = self.response.slope(eta, self.answers, self.trials, rates)
            slope = scale * self.effects.of_effects(gap) - b
            if float(slope @ step) < -promised:
                # As steep down again as it was up: a step as long would come back for ever.
                step, promised = 0.5 * step, 0.5 * promised
                b = b - step
                continue
            try:
                arrow = self.effects.arrow(weight, scale)
            except np.linalg.LinAlgError:
                # Guesses and lapses can bend the likelihood the wrong way far from the mode.
                weight = expected
                arrow = self.effects.arrow(weight, scale)
            if done:  # the curvature is the one at the mode itself
                break
            step = arrow.solve(slope)
            largest = float(np.abs(step).max(initial=0.0))
            # The joint density is log-concave; long steps far from the mode are cut short.
            step = step * min(1.0, LONGEST_STEP / max(largest, 1e-300))
            promised = float(slope @ step)
            b, done = b + step, largest < SMALL_STEP
        self.mode = b
        bowl, curved = arrow, weight
        if not self.response.concave:
            # Guesses bend it so much that the curvature at one place makes up likelihood.
            bowl, curved = self.effects.arrow(expected, scale), expected
        joint = self.response.log_likelihood(eta, self.answers, self.trials, rates)
        value = 0.5 * float(b @ b) - joint + 0.5 * bowl.log_det - self.response.penalty(free)
        value -= steep_prior(beta, self.steepest)[0]
        return _Mode(value, b, scale, eta, gap, weight, rates, arrow, curved, bowl)

    def _slope(self, theta: Floats, at: "_Mode[R]") -> Floats:
        """Return the slope in all parameters; the mode moves along with each."""
        leverage, trace = self.effects.leverage(at.bowl, at.curved, at.scale)
        force = 0.5 * leverage * self._bend(at)
        moved = at.arrow.solve(at.scale * self.effects.of_effects(force))
        pull = force - at.gap - at.weight * self.effects.on_trials(at.scale * moved)
        by_effect = at.b * self.effects.of_effects(pull)
        by_effect = by_effect + moved * self.effects.of_effects(at.gap)
        by_sd = trace + self.effects.totals(by_effect)
        sign = np.where(np.split(theta, self._ends)[1] < 0, -1.0, 1.0)
        prior = steep_prior(theta[: self.steepest.size], self.steepest)[1]
        free = self._free_slope(theta, at, 0.5 * leverage, moved)
        return np.concatenate([self.design.T @ pull - prior, sign * by_sd, free])

    def _free_slope(
        self, theta: Floats, at: "_Mode[R]", weighed: Floats, moved: Floats
    ) -> list[float]:
        """Return the slope in the free numbers of the law, by differences of the law alone."""
        free = np.split(theta, self._ends)[2]
        along = self.effects.on_trials(at.scale * moved)
        found = []
        for step in RATE_STEP * np.eye(free.size):
            ends = []
            for end in (free + step, free - step):
                rates = self.response.rates(end)
                gap, *curves = self.response.slope(at.eta, self.answers, self.trials, rates)
                joint = self.response.log_likelihood(at.eta, self.answers, self.trials, rates)
                curved = curves[not self.response.concave]
                value = weighed @ curved + along @ gap - joint - self.response.penalty(end)
                ends.append(float(value))
            found.append((ends[0] - ends[1]) / (2.0 * RATE_STEP))
        return found

    def _bend(self, at: "_Mode[R]") -> Floats:
        """Return the slope of each trial's weight in the determinant along eta."""
        if self.response.plain:
            return np.asarray(at.weight * (1.0 - 2.0 * expit(at.eta)))
        which = 1 if self.response.concave else 2
        up, down = (
            self.response.slope(at.eta + shift, self.answers, self.trials, at.rates)[which]
            for shift in (BEND_STEP, -BEND_STEP)
        )
        return np.asarray((up - down) / (2.0 * BEND_STEP))


@dataclass(frozen=True)
class _Mode(Generic[R]):
    """Minus the Laplace likelihood, the effects `b` at their mode, and the trials there.

    `bowl` is the curvature whose determinant counts, and `curved` the trials' part of it.
    """

    value: float
    b: Floats
    scale: Floats
    eta: Floats
    gap: Floats
    weight: Floats
    rates: R
    arrow: Arrow
    curved: Floats
    bowl: Arrow
