"""Ordered ratings, ties among them: cumulative-link models with random effects."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pandas as pd
import scipy
from scipy.special import expit, ndtr, ndtri

from analysis.arrays import Floats, Ints
from analysis.models.cells import checked, grid, numbered, one_condition
from analysis.models.contrasts import (
    IN_CONDITION,
    MOST_IN_PAIRS,
    CrossedDesign,
    Difference,
    Pair,
    holm_where_known,
    pairs_of,
    unidentified,
    wald,
)
from analysis.models.mixed.deviations import Deviation
from analysis.models.mixed.glmm import CountedTrials, LaplaceLikelihood, laplace_deviations
from analysis.models.mixed.inference import USUAL, Inference
from analysis.models.mixed.marginal_means import NO_MARGINS, Asked, Margins, margins
from analysis.models.mixed.profile import HeldContrast, Maximum, ratio_test
from analysis.models.numeric import chi_squared_p, slope_hessian
from analysis.models.right_answers import FEW_PARTICIPANTS
from protocols.tasks.rates import name_of

OrdinalLink = Literal["probit", "logit"]

START_SD = 0.5
LARGEST = 30.0
"""A linear predictor or deviation beyond has run away: a category that nobody chose."""

SEPARATED = 10.0
"""Conditions so far apart share no rating: no finite distance fits better than a larger one."""

FLAT = 1e-6
"""Curvature given to directions in which the likelihood is flat: an error of 1000 there."""

MISFIT_P = 0.001


@dataclass(frozen=True)
class RandomFactor:
    """Levels of a random effect in each row, and what they are multiplied by.

    Attributes
    ----------
    level : ndarray (rows,) or (rows, members)
        Counted from 0; several where a row has several effects, as those of two methods compared.
    times : ndarray like `level`, optional
        Left out: 1.
    """

    level: Ints
    times: Floats | None = None

    def drawn(self, sd: float, rng: np.random.Generator) -> Floats:
        """Return each row's sum of effects (rows,), drawn with a deviation."""
        values = sd * rng.standard_normal(int(self.level.max()) + 1)[self.level]
        if self.times is not None:
            values = values * self.times
        return np.asarray(values.reshape(len(values), -1).sum(axis=1))


@dataclass(frozen=True)
class CumulativeFit:
    """P(y <= j) = F(theta_j - x beta - z b), by Laplace's method.

    `covariance` is of theta, then beta, then sd. `converged` is False where the likelihood has no
    proper maximum; errors of what it leaves open are then far above `LARGEST`.
    """

    theta: Floats
    beta: Floats
    sd: Mapping[str, float]
    covariance: Floats
    log_likelihood: float
    converged: bool
    maximum: Maximum
    deviations: tuple[Deviation, ...] = ()


@dataclass(frozen=True)
class RatedCondition:
    """Place of one condition on the latent axis, and the shares of its ratings.

    `place` is relative to the first condition, in standard deviations of one person's ratings
    (probit) or logits; NaN, as its limits, where the ratings do not identify it. `shares` holds
    how often each rating was given.
    """

    condition: str
    place: float
    lower: float
    upper: float
    mean_rating: float
    ratings: int
    shares: tuple[float, ...]


@dataclass(frozen=True)
class RatingDifference:
    """Difference of two conditions in ratings, first minus second; p tests that there is none.

    `superiority` is the chance that the same person rates the first higher at one showing of
    each, on the latent axis, where nothing ties. p is of the likelihood ratio against equal
    conditions, whose signed root is `t`, by t or by bootstrap; limits are those of the profile
    likelihood. What the ratings do not identify is NaN.
    """

    first: str
    second: str
    difference: float
    lower: float
    upper: float
    level: float
    df: float
    p: float
    p_adjusted: float
    superiority: float
    t: float


@dataclass(frozen=True)
class RatingModel:
    """Ordered ratings by condition, random over participants and scenes.

    Attributes
    ----------
    categories : tuple of str
        From the lowest; of a declared scale also those that nobody chose.
    margins : Margins
        Of places from the middle of all thresholds.
    thresholds : tuple of float
        Between neighbouring categories in use, on the latent axis of the first condition; NaN
        where the ratings do not identify them.
    sd : mapping
        Between participants and scenes, and of their deviations in a condition (`IN_CONDITION`
        after the name).
    """

    link: OrdinalLink
    categories: tuple[str, ...]
    thresholds: tuple[float, ...]
    conditions: tuple[RatedCondition, ...]
    contrasts: tuple[RatingDifference, ...]
    sd: Mapping[str, float]
    log_likelihood: float
    level: float
    ratings: int
    participants: int
    warnings: tuple[str, ...]
    deviations: tuple[Deviation, ...] = ()
    margins: Margins = NO_MARGINS

    @property
    def used(self) -> tuple[str, ...]:
        """Categories that were chosen, from the lowest."""
        chosen = np.any([one.shares for one in self.conditions], axis=0)
        return tuple(name for name, some in zip(self.categories, chosen, strict=True) if some)

    @property
    def steps(self) -> dict[str, float]:
        """Place of each category on its scale, in the least step between two of them."""
        gaps = np.abs(np.diff(_scale_numbers(self.categories)))
        return dict(zip(self.categories, [0.0, *np.cumsum(gaps / gaps.min())], strict=True))


@dataclass(frozen=True)
class OrderedLaw:
    """Law of ordered answers, P(y <= j) = F(theta_j - eta), for `LaplaceLikelihood`.

    What trials share are the thresholds, with an infinite one at both ends. Its free numbers are
    the first and the logarithms of the gaps between them, which keep them in order.
    """

    link: OrdinalLink
    concave = True
    plain = False

    def of(self, _trials: Ints) -> "OrderedLaw":
        """Return the law of some trials: the same."""
        return self

    def rates(self, free: Floats) -> Floats:
        """Return the thresholds, and their ends."""
        gaps = np.exp(np.clip(free[1:], -LARGEST, LARGEST))
        return np.concatenate([[-np.inf], free[0] + np.cumsum([0.0, *gaps]), [np.inf]])

    def penalty(self, _free: Floats) -> float:
        """Return 0: no threshold is likelier than another before there are answers."""
        return 0.0

    def log_likelihood(self, eta: Floats, answers: Floats, trials: Floats, rates: Floats) -> float:
        """Return the log-likelihood; `answers` are categories, counted from 0."""
        return float(trials @ self._answers(eta, answers, rates)[0])

    def slope(
        self, eta: Floats, answers: Floats, trials: Floats, rates: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Return the slope in eta, and minus the curvature: it stands for the expected one too."""
        _, slope, bend = self._answers(eta, answers, rates)
        return trials * slope, trials * bend, trials * bend

    def _answers(
        self, eta: Floats, answers: Floats, edges: Floats
    ) -> tuple[Floats, Floats, Floats]:
        category = answers.astype(np.int64)
        return _answers(edges[category + 1], edges[category], eta, self.link)


def fit_cumulative(
    design: Floats,
    y: Ints,
    effects: Mapping[str, RandomFactor],
    *,
    link: OrdinalLink = "probit",
    level: float | None = None,
    errors: bool = True,
) -> CumulativeFit:
    """Maximise the Laplace likelihood of a cumulative-link mixed model.

    Parameters
    ----------
    design : ndarray (rows, coefficients)
        Without a constant: the thresholds are.
    y : ndarray (rows,)
        Category, counted from 0; every one up to the highest occurs.
    effects : mapping of name to RandomFactor
        Each random effect's levels in each row.
    level : float, optional
        Coverage of profile limits of the deviations; left out, there are none.
    errors : bool
        Without them a fit is quick, and enough for a likelihood ratio.

    Notes
    -----
    McCullagh 1980; random effects as package ordinal's clmm (Christensen 2022), by Laplace's
    method (`LaplaceLikelihood`). The log-likelihood is concave in the effects.
    """
    top, coefficients = int(y.max()), design.shape[1]
    cut = (coefficients, coefficients + len(effects))
    counted = CountedTrials.of(
        design,
        y,
        [one.level for one in effects.values()],
        [one.times for one in effects.values()],
        ordered=True,
    )
    model = LaplaceLikelihood(design, counted, OrderedLaw(link))
    share = np.cumsum(np.bincount(y)[:top]) / y.size
    first = ndtri(share) if link == "probit" else np.log(share / (1.0 - share))
    begin = np.concatenate(
        [
            np.zeros(coefficients),
            np.full(len(effects), START_SD),
            first[:1],
            np.log(np.maximum(np.diff(first), 1e-3)),
        ]
    )
    options = {"gtol": 1e-5 if errors else 1e-3, "hess_inv0": model.rough_covariance(begin)}
    found = scipy.optimize.minimize(model, begin, jac=True, method="BFGS", options=options)
    beta, sd, free = np.split(found.x, cut)
    theta, sd = model.response.rates(free)[1:-1], np.abs(sd)
    by_name = {
        name: float(value) if value < LARGEST else np.nan
        for name, value in zip(effects, sd, strict=True)
    }
    if not errors:
        maximum = Maximum(model, found.x, found.hess_inv, range(*cut))
        return CumulativeFit(theta, beta, by_name, found.hess_inv, -float(found.fun), True, maximum)
    point, natural = np.concatenate([beta, sd, free]), np.concatenate([beta, sd, theta])
    # From the free numbers to thresholds: each gap moves all that lie above it.
    turn = np.eye(natural.size)
    turn[cut[1] :, cut[1] :] = np.tril(np.ones((top, top))) * np.append(1.0, np.diff(theta))
    back = np.linalg.inv(turn)
    hessian = back.T @ slope_hessian(model, point) @ back
    proper = bool(np.all(np.isfinite(hessian))) and float(sd.max(initial=0.0)) < LARGEST
    covariance = np.eye(natural.size) / FLAT
    # At sd 0 the likelihood is even in sd: its curvature may vanish there, and nowhere else.
    fixed = np.concatenate([np.arange(cut[0]), np.arange(cut[1], natural.size)])
    if proper:
        curvature, axes = np.linalg.eigh(hessian[np.ix_(fixed, fixed)])
        proper = bool(curvature[0] > LARGEST**-2) and float(np.abs(natural).max()) < LARGEST
        covariance = np.asarray(np.linalg.pinv(hessian, hermitian=True), dtype=np.float64)
        if not proper or float(np.diag(covariance)[fixed].min()) <= 0.0:
            covariance[np.ix_(fixed, fixed)] = axes / np.maximum(curvature, FLAT) @ axes.T
    maximum = Maximum(model, point, back @ covariance @ back.T, range(*cut))
    deviations: tuple[Deviation, ...] = ()
    if level is not None and proper:
        sds = dict(zip(effects, sd.tolist(), strict=True))
        deviations = laplace_deviations(maximum, sds, model.effects.count, link=link, level=level)
    in_order = np.concatenate([np.arange(cut[1], natural.size), np.arange(cut[1])])
    return CumulativeFit(
        theta=theta,
        beta=beta,
        sd=by_name,
        covariance=covariance[np.ix_(in_order, in_order)],
        log_likelihood=maximum.log_likelihood,
        converged=proper,
        maximum=maximum,
        deviations=deviations,
    )


def rating_model(
    trials: pd.DataFrame,
    by: Sequence[str],
    *,
    categories: Sequence[str] | None = None,
    reference: str | None = None,
    link: OrdinalLink = "probit",
    asked: Asked | None = None,
    inference: Inference = USUAL,
) -> RatingModel:
    """Compare ordered ratings between conditions.

    Parameters
    ----------
    trials : DataFrame, one row per rating
        ``participant``, optionally ``scene``, the columns `by`, and ``rating``.
    categories : sequence of str, optional
        All ratings as text, from the lowest; left out: numbers in order.
    reference : str, optional
        Condition that the others are compared with; left out, all pairs.
    asked : mapping of name to weights of conditions, optional
        Contrasts of places, in `RatingModel.margins`.

    Raises
    ------
    ValueError
        If columns are missing, a rating is none of the categories, or there is nothing to
        compare: fewer than two people, conditions, or ratings in use.

    Notes
    -----
    Random are participants, scenes where there are several, and the deviations of both in a
    condition (left out where each has one rating of it: these cannot tell it from chance).
    Differences, and places, which are those from the first condition, have limits of the profile
    likelihood, and p of the likelihood ratio's root; by t with degrees of freedom between those of
    participants and of scenes (`contrasts.CrossedDesign`). Categories nobody chose have no
    thresholds of their own, and keep their number in means.
    """
    rows = checked(trials, ("rating",), by)
    texts = rows["rating"].map(name_of)
    known = list(categories) if categories is not None else _numbers(texts)
    unknown = sorted(set(texts) - set(known))
    if unknown:
        raise ValueError(f"column 'rating' must hold one of {known} (found {unknown[0]!r})")
    used = [name for name in known if (texts == name).any()]
    y = _codes(texts, used)
    places, (parts, condition) = grid(rows), numbered(rows, by)
    names = [name for name, _ in parts]
    people = len(places.participants)
    if lack := lacking(people, len(names), len(used)):
        raise ValueError(lack)
    pairs = pairs_of(names, reference)
    groups = places.several
    cells = {
        name: np.unique(cell, return_inverse=True)[1].ravel()
        for name, cell in places.in_conditions(condition).items()
    }
    effects = {name: RandomFactor(code) for name, code in (groups | cells).items()}
    chosen = _codes(texts, known)
    rated = _Trials(
        _indicator(condition, len(names)), y, effects, link,
        {name: chosen[part.index.to_numpy()] for name, part in parts}, known,
    )  # fmt: skip
    fit = rated.fit(inference)
    notes = _notes(fit, people, [name for name in known if name not in used])
    notes += [
        f"each {name} has one rating of a condition: how it departs there is part of the SD"
        for name, code in groups.items()
        if name + IN_CONDITION not in effects and not one_condition(code, condition)
    ]
    notes += _misfit(rated, condition)
    crossed = CrossedDesign.of(condition, groups, fit.sd)
    return _model(rated, pairs, fit, crossed, notes, asked, inference)


def lacking(people: int, conditions: int, ratings: int) -> str:
    """Return the data that ratings lack to be compared; empty: nothing."""
    counted = {"participant": people, "condition": conditions, "rating": ratings}
    few = [name for name, count in counted.items() if count < 2]
    if not few:
        return ""
    return (
        "ratings must be of two participants, two conditions and two different ratings at least"
        f" (found {people}, {conditions} and {ratings}); add those of another"
        f" {' and of another '.join(few)}"
    )


def paired_ratings(
    decisions: pd.DataFrame,
    *,
    reference: str | None = None,
    link: OrdinalLink = "probit",
    asked: Asked | None = None,
    inference: Inference = USUAL,
) -> RatingModel:
    """Place methods on one axis by graded comparisons of pairs, with ties.

    Parameters
    ----------
    decisions : DataFrame, one row per comparison
        ``participant``, optionally ``scene``, ``first``, ``second``, and ``rating``: a number, the
        larger the more the first is better; 0 where neither is, such as -1, 0, 1.

    Raises
    ------
    ValueError
        As `rating_model`.

    Notes
    -----
    Agresti 1992 (Analysis of ordinal paired comparison data, Applied Statistics 41, 287-297): a
    cumulative-link model in the difference of two places. Random is a participant's liking of
    each method, and a scene's, where there are several. Thresholds that are not symmetric are a
    bias to one of the two places. Limits and tests as of `rating_model`.
    """
    rows = checked(decisions, ("first", "second", "rating"))
    texts = rows["rating"].map(name_of)
    used = _numbers(texts)
    y = _codes(texts, used)
    names = sorted({*rows["first"].astype(str), *rows["second"].astype(str)})
    places = grid(rows)
    people = len(places.participants)
    if lack := lacking(people, len(names), len(used)):
        raise ValueError(lack)
    pairs = pairs_of(names, reference)
    place = {name: k for k, name in enumerate(names)}
    sides = [rows[side].astype(str).map(place).to_numpy(np.int64) for side in ("first", "second")]
    gap = _indicator(sides[0], len(names)) - _indicator(sides[1], len(names))
    groups = places.several
    effects: dict[str, RandomFactor] = {}
    for group, code in groups.items():
        both = np.stack([code * len(names) + side for side in sides], axis=1)
        liked = np.unique(both, return_inverse=True)[1].reshape(both.shape)
        effects[group + IN_CONDITION] = RandomFactor(liked, np.array([[1.0, -1.0]] * len(rows)))
    given = {name: y[(sides[0] == k) | (sides[1] == k)] for k, name in enumerate(names)}
    rated = _Trials(gap, y, effects, link, given, used)
    fit = rated.fit(inference)
    twice = {group: np.concatenate([code, code]) for group, code in groups.items()}
    crossed = CrossedDesign.of(np.concatenate(sides), twice, fit.sd)
    model = _model(rated, pairs, fit, crossed, _notes(fit, people, []), asked, inference)
    # What the first of a pair has more moves all thresholds, and no condition's own place.
    return replace(model, margins=replace(model.margins, means=()))


@dataclass(frozen=True)
class _Trials:
    """Trials of a model of ratings; `conditions` (trials, conditions) has all of them.

    `given` holds the ratings of each condition, as places on `scale`.
    """

    conditions: Floats
    y: Ints
    effects: Mapping[str, RandomFactor]
    link: OrdinalLink
    given: Mapping[str, Ints]
    scale: Sequence[str]

    def fit(self, inference: Inference) -> CumulativeFit:
        """Fit the model of all conditions."""
        return fit_cumulative(
            self.conditions[:, 1:], self.y, self.effects, link=self.link,
            level=inference.profile_level,
        )  # fmt: skip


def _rating_difference(
    trials: _Trials, fit: CumulativeFit, gap: Difference, inference: Inference
) -> RatingDifference:
    """Return a difference, judged by t or by drawing ratings from the model where it is 0.

    Wald's p and limits stay where the likelihood has no proper maximum, and of many conditions;
    what ratings do not identify has no numbers.
    """
    if not _told(gap.difference, gap.standard_error):
        gap = unidentified(gap)
    higher = superiority(gap.difference, trials.link)
    plain = RatingDifference(
        gap.first, gap.second, gap.difference, gap.lower, gap.upper, gap.level, gap.df, gap.p,
        gap.p_adjusted, higher, gap.t,
    )  # fmt: skip
    names = list(trials.given)
    if math.isnan(gap.difference) or len(names) > MOST_IN_PAIRS:
        return plain
    first, second = np.eye(len(names))[[names.index(gap.first), names.index(gap.second)]]
    weights = (first - second)[1:]
    held = HeldContrast(fit.maximum, weights)

    def drawn(rng: np.random.Generator) -> float:
        rows, link = trials.y.size, trials.link
        noise = rng.standard_normal(rows) if link == "probit" else rng.logistic(size=rows)
        latent = trials.conditions[:, 1:] @ beta + noise
        for effect, own in zip(trials.effects.values(), sd, strict=True):
            latent += effect.drawn(abs(float(own)), rng)
        steps, given = np.unique(np.digitize(latent, theta), return_inverse=True)
        if steps.size < 2:
            return math.nan
        study = fit_cumulative(
            trials.conditions[:, 1:], given.ravel(), trials.effects, link=link, errors=False
        )
        return HeldContrast(study.maximum, weights).ratio()[0]

    draws = None
    if inference.draws is not None:
        less = held.ratio()[1]
        beta, sd, free = np.split(less, np.cumsum([fit.beta.size, len(trials.effects)]))
        theta = OrderedLaw(trials.link).rates(free)[1:-1]
        draws = inference.draws.ratios(drawn)
    found = ratio_test(
        held, fit.log_likelihood, gap.difference, gap.standard_error, gap.df, inference.level, draws
    )
    return replace(plain, p=found.p, lower=found.lower, upper=found.upper, t=found.root)


def _model(
    trials: _Trials,
    pairs: Sequence[Pair],
    fit: CumulativeFit,
    crossed: CrossedDesign,
    notes: Sequence[str],
    asked: Asked | None,
    inference: Inference,
) -> RatingModel:
    names, level = list(trials.given), inference.level

    def compared(pairs: Sequence[Pair]) -> list[RatingDifference]:
        gaps = wald("place", names, pairs, *_places(fit), crossed=crossed, level=level)
        return [_rating_difference(trials, fit, gap, inference) for gap in gaps]

    tested = compared(pairs)
    limits = {(one.first, one.second): (one.lower, one.upper) for one in tested}
    limits |= {(second, first): (-high, -low) for (first, second), (low, high) in limits.items()}
    # Places are distances from the first condition, whose limits are those of the comparison.
    more = compared([(name, names[0]) for name in names[1:] if (name, names[0]) not in limits])
    limits |= {(one.first, one.second): (one.lower, one.upper) for one in more}
    errors = np.sqrt(np.diag(fit.covariance)[: fit.theta.size])
    located = np.concatenate([fit.theta, fit.beta])
    return RatingModel(
        link=trials.link,
        categories=tuple(trials.scale),
        thresholds=tuple(
            float(theta) if _told(theta, error) else np.nan
            for theta, error in zip(fit.theta, errors, strict=True)
        ),
        conditions=_rated(trials, fit, {name: limits.get((name, names[0])) for name in names}),
        contrasts=tuple(
            replace(one, p_adjusted=own)
            for one, own in zip(tested, holm_where_known([one.p for one in tested]), strict=True)
        ),
        sd=fit.sd,
        log_likelihood=fit.log_likelihood,
        level=level,
        ratings=trials.y.size,
        participants=len(crossed.shares["participant"]),
        warnings=tuple(notes),
        deviations=fit.deviations,
        margins=margins(
            names,
            _from_middle(fit, len(names)),
            located,
            fit.covariance[: located.size, : located.size],
            crossed.df,
            level=level,
            asked=asked or {},
        ),
    )


def _from_middle(fit: CumulativeFit, conditions: int) -> Floats:
    """Return rows (conditions, coefficients) of places from the middle of all thresholds."""
    thresholds = np.full((conditions, fit.theta.size), -1.0 / fit.theta.size)
    return np.hstack([thresholds, np.eye(conditions)[:, 1:]])


def _told(value: float, error: float) -> bool:
    """Return True if the ratings identify a distance on the latent axis."""
    return abs(value) <= SEPARATED and error <= LARGEST


def _answers(
    upper: Floats, lower: Floats, eta: Floats, link: OrdinalLink
) -> tuple[Floats, Floats, Floats]:
    """Return the log-likelihood of each row, its slope in eta, and minus its curvature."""
    a, b = upper - eta, lower - eta
    flipped = b > 0.0  # differences of upper tails keep their digits
    high, low = np.where(flipped, -b, a), np.where(flipped, -a, b)
    rise = ndtr if link == "probit" else expit
    share = np.maximum(rise(high) - rise(low), 1e-300)
    first, second = [], []
    for edge in (a, b):
        finite = np.where(np.isfinite(edge), edge, 0.0)
        if link == "probit":
            density = np.exp(-0.5 * finite**2) / np.sqrt(2.0 * np.pi)
            turn = -finite * density
        else:
            chance = expit(finite)
            density = chance * (1.0 - chance)
            turn = density * (1.0 - 2.0 * chance)
        first.append(np.where(np.isfinite(edge), density, 0.0))
        second.append(np.where(np.isfinite(edge), turn, 0.0))
    slope = -(first[0] - first[1]) / share
    bend = slope**2 - (second[0] - second[1]) / share
    return np.log(share), slope, np.maximum(bend, 0.0)


def _indicator(code: Ints, count: int | None = None) -> Floats:
    size = int(code.max()) + 1 if count is None else count
    return np.asarray(code[:, None] == np.arange(size), dtype=np.float64)


def _codes(texts: pd.Series, used: Sequence[str]) -> Ints:
    place = {name: k for k, name in enumerate(used)}
    return np.array([place[text] for text in texts], dtype=np.int64)


def _numbers(texts: pd.Series) -> list[str]:
    numbers = pd.to_numeric(texts, errors="coerce")
    if not bool(np.isfinite(numbers.astype(float)).all()):
        raise ValueError(
            "column 'rating' must hold numbers, or its categories be given from the lowest on"
        )
    ordered = pd.Series(numbers.to_numpy(), index=texts.to_numpy()).sort_values()
    return list(dict.fromkeys(ordered.index))


def _notes(fit: CumulativeFit, people: int, unused: Sequence[str]) -> list[str]:
    notes = []
    if not fit.converged or np.abs(fit.beta).max(initial=0.0) > SEPARATED:
        notes.append(
            "the model has no proper maximum (conditions, or people, share too few ratings): what"
            " has no number is not identified by these data"
        )
    if people < FEW_PARTICIPANTS:
        notes.append(f"only {people} participants: limits and p are a rough guide")
    if unused:
        notes.append(f"nobody chose {', '.join(unused)}: without thresholds of their own")
    return notes


def _misfit(trials: _Trials, condition: Ints) -> list[str]:
    """Return a note where conditions differ by more than a shift: own thresholds fit far better."""
    plain = fit_cumulative(trials.conditions[:, 1:], trials.y, {}, link=trials.link)
    table = np.zeros((int(condition.max()) + 1, int(trials.y.max()) + 1))
    np.add.at(table, (condition, trials.y), 1.0)
    share = table / table.sum(axis=1, keepdims=True)
    free = float(np.sum(table[table > 0] * np.log(share[table > 0])))
    df = (table.shape[0] - 1) * (table.shape[1] - 2)
    if df > 0 and chi_squared_p(2.0 * (free - plain.log_likelihood), df) < MISFIT_P:
        return [
            "conditions differ by more than a shift of all ratings (proportional odds do not hold):"
            " read the shares of each rating too"
        ]
    return []


def _rated(
    trials: _Trials, fit: CumulativeFit, limits: Mapping[str, tuple[float, float] | None]
) -> tuple[RatedCondition, ...]:
    """Return the conditions; `limits` are those of their places, None of the first."""
    value, covariance = _places(fit)
    error = np.sqrt(np.diag(covariance).clip(min=0))
    numbers = _scale_numbers(trials.scale)
    found = []
    for k, (name, own) in enumerate(trials.given.items()):
        lower, upper = limits[name] or (0.0, 0.0)
        found.append(
            RatedCondition(
                condition=name,
                place=float(value[k]) if _told(value[k], error[k]) else np.nan,
                lower=lower,
                upper=upper,
                mean_rating=float(numbers[own].mean()),
                ratings=own.size,
                shares=tuple(float(np.mean(own == j)) for j in range(numbers.size)),
            )
        )
    return tuple(found)


def _scale_numbers(scale: Sequence[str]) -> Floats:
    """Return the number of each category: its own, or its place on the scale, from 1."""
    numbers = pd.to_numeric(pd.Series(list(scale)), errors="coerce").to_numpy(dtype=np.float64)
    if np.isfinite(numbers).all() and np.unique(numbers).size == len(scale):
        return numbers
    return np.arange(1.0, len(scale) + 1.0)


def _places(fit: CumulativeFit) -> tuple[Floats, Floats]:
    """Return the places of conditions, the first at 0, and the covariance."""
    top, size = fit.theta.size, fit.beta.size
    value = np.concatenate([[0.0], fit.beta])
    covariance = np.zeros((size + 1, size + 1))
    covariance[1:, 1:] = fit.covariance[top : top + size, top : top + size]
    return value, covariance


def superiority(gap: float, link: OrdinalLink = "probit") -> float:
    """Return the chance that a draw `gap` higher exceeds one of the same law.

    Normal: Phi(gap / sqrt 2). Logistic: e^g (e^g - 1 - g) / (e^g - 1)^2, and 1/2 at 0.
    """
    if link == "probit":
        return float(ndtr(gap / np.sqrt(2.0)))
    if abs(gap) < 1e-4:
        return 0.5 + gap / 6.0
    if gap < 0:
        return 1.0 - superiority(-gap, link)
    small = float(np.exp(-gap))
    return (1.0 - small * (1.0 + gap)) / (1.0 - small) ** 2
