"""Thresholds by condition with participants (and scenes) as random: one model of all trials."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
import scipy
from scipy.special import logit

from analysis.arrays import Floats, Ints
from analysis.models.cells import TrialGrid, checked, grid, numbered, one_condition
from analysis.models.contrasts import IN_CONDITION, CrossedDesign, Difference, pairs_of
from analysis.models.curves.population import Population, Threshold, span
from analysis.models.curves.quadrature import STARTS, PeopleFit, fit_people
from analysis.models.curves.response import TWO_ALTERNATIVES, CurveForm, ResponseFunction
from analysis.models.mixed.glmm import fit_crossed
from protocols.adaptive.answer_history import Shape
from protocols.errors import count_of

FEW_PARTICIPANTS = 5

NARROWEST = 0.9
"""Share of the least gap between two levels: answers at these tell no curve from a narrower one."""


@dataclass(frozen=True)
class ThresholdModel:
    """Psychometric functions of all conditions, of one width, fitted together.

    Attributes
    ----------
    thresholds : tuple of Threshold
    contrasts : tuple of Difference
        Differences of thresholds; of their natural logarithms where levels are logarithmic.
    guess : float
        Shared by all.
    lapse : float
        Mean of the participants; where it is fitted each has an own one.
    participant_sd, interaction_sd, scene_sd, scene_interaction_sd : float
        Of thresholds (of their logarithms): between participants, of a participant's deviation
        in one condition (0 with a single condition), and both of scenes (0 without).
    """

    shape: Shape
    falling: bool
    logarithmic: bool
    thresholds: tuple[Threshold, ...]
    contrasts: tuple[Difference, ...]
    guess: float
    lapse: float
    participant_sd: float
    interaction_sd: float
    scene_sd: float
    scene_interaction_sd: float
    log_likelihood: float
    level: float
    trials: int
    participants: int
    warnings: tuple[str, ...]
    population: Population = field(repr=False)

    def __getitem__(self, condition: str) -> Threshold:
        return {one.condition: one for one in self.thresholds}[condition]


def fit_thresholds(
    trials: pd.DataFrame,
    level_column: str,
    by: Sequence[str] = (),
    curve: CurveForm = TWO_ALTERNATIVES,
    *,
    scenes: bool = False,
    reference: str | None = None,
    level: float = 0.95,
) -> ThresholdModel:
    """Fit psychometric functions whose thresholds vary between participants.

    Parameters
    ----------
    trials : DataFrame, one row per decided trial
        ``participant``, `level_column` (a number), ``correct`` (0/1), the columns `by`.
    curve : CurveForm
        Of all people. Rates that are fitted are drawn towards small ones (`response.RATE_PRIOR`).
        `falling` matters for ``gumbel`` and ``weibull``: the slope is free all the same. Needs
        `logarithmic` for ``weibull``; thresholds vary along the same axis.
    scenes : bool
        Scenes are drawn from many too (column ``scene``).
    reference : str, optional
        Condition that the others are compared with; left out, all pairs.

    Raises
    ------
    ValueError
        If columns are missing, there are fewer than two participants or levels, or levels that
        have no logarithm.

    Notes
    -----
    p = guess + (1 - guess - lapse) F(eta), eta = (x - threshold) / scale, where the threshold is
    the condition's mean plus a participant's deviation, plus the deviation of that participant
    in that condition. Participants, and their lapse rates, are integrated out by quadrature
    (`quadrature.fit_people`). With scenes the same deviations of scenes are added, and all are
    integrated out by Laplace's method (`glmm.fit_crossed`), at each participant's lapse rate of
    the model without scenes. Limits and tests: delta method, by t with degrees of freedom of
    participants, and between these and those of scenes (`contrasts.CrossedDesign`), because so many
    people and scenes, and not so many trials, tell the mean.
    """
    rows, x, places = _along(trials, level_column, by, curve)
    centre, spread = float(x.mean()), float(x.std())
    parts, condition = numbered(rows, by)
    names = [name for name, _ in parts]
    pairs = pairs_of(names, reference)
    place, scaled = condition[:, None] == np.arange(len(names)), (x - centre) / spread
    design, response = np.column_stack([place, scaled]), curve.response
    y = rows["correct"].to_numpy(dtype=np.float64)
    gap = float(np.diff(np.unique(scaled)).min())
    steepest = np.append(np.full(len(names), np.inf), span(response) / (NARROWEST * gap))
    start, person = _pooled(design, y, response), places.person
    groups = places.several if scenes else {"participant": person}
    kinds = _kinds(groups, condition)
    alone = len(names) > 1 and "participant" + IN_CONDITION not in kinds
    within = np.zeros_like(condition) if alone else condition
    fit = fit_people(design, y, person, within, response=response, start=start, steepest=steepest)
    if alone:
        seen = np.full((len(places.participants), len(names)), np.nan)
        seen[person, condition] = fit.own[person, 0]
        fit = replace(fit, own=seen)
    over_scenes = None
    if len(groups) > 1:
        over_scenes = _over_scenes(fit, design, y, groups, condition, response, steepest)
        fit = over_scenes or fit
    notes = _notes(fit, len(places.participants))
    if len(groups) > 1 and over_scenes is None and fit.converged:
        groups = {"participant": person}
        notes.append("no model of scenes could be fitted: thresholds are about these scenes")
    typical = abs(float(fit.beta[-1]))
    sd = dict(zip(kinds, (fit.sd * spread / typical).tolist(), strict=False))
    crossed = CrossedDesign.of(condition, groups, sd)
    population = Population(
        names=tuple(names),
        pairs=tuple(pairs),
        theta=np.concatenate([fit.beta, fit.sd, fit.rates]),
        covariance=_widened(fit, crossed, len(names) if alone else 1, typical / spread),
        kinds=tuple(kinds[: fit.sd.size]),
        centre=centre,
        spread=spread,
        logarithmic=curve.logarithmic,
        response=response,
        own=_own(fit, names, places.participants),
        crossed=crossed,
        levels=tuple(float(value) for value in rows[level_column].unique()),
        level=level,
        proper=fit.converged,
    )
    found, contrasts = population.thresholds()
    notes += _not_told(population, contrasts, x, condition)
    if not fit.converged or all(np.isnan(one.value) for one in found):
        sd = dict.fromkeys(sd, np.nan)
    return ThresholdModel(
        shape=curve.shape,
        falling=curve.falling,
        logarithmic=curve.logarithmic,
        thresholds=found,
        contrasts=contrasts,
        guess=fit.guess,
        lapse=fit.lapse,
        participant_sd=sd["participant"],
        interaction_sd=sd.get("participant" + IN_CONDITION, 0.0),
        scene_sd=sd.get("scene", 0.0),
        scene_interaction_sd=sd.get("scene" + IN_CONDITION, 0.0),
        log_likelihood=fit.log_likelihood,
        level=level,
        trials=len(rows),
        participants=len(places.participants),
        warnings=tuple(notes),
        population=population,
    )


def _along(
    trials: pd.DataFrame, level_column: str, by: Sequence[str], curve: CurveForm
) -> tuple[pd.DataFrame, Floats, TrialGrid]:
    """Return the trials, where each lies along the curve, and whose it is."""
    rows = checked(trials, (level_column, "correct"), by)
    raw = pd.to_numeric(rows[level_column], errors="coerce").to_numpy(dtype=np.float64)
    if not np.all(np.isfinite(raw)):
        raise ValueError(f"column {level_column!r} must hold numbers, in every row")
    x, places = curve.axis(raw, f"column {level_column!r}"), grid(rows)
    if len(places.participants) < 2 or np.unique(raw).size < 2:
        raise ValueError(
            "trials must hold two participants and two levels at least"
            f" (found {len(places.participants)} and {np.unique(raw).size})"
        )
    return rows, x, places


def _widened(fit: PeopleFit, crossed: CrossedDesign, samples: int, steep: float) -> Floats:
    """Return the covariance of parameters; `samples` of people, who saw other conditions."""
    people, conditions = crossed.shares["participant"].shape
    # Likelihood takes deviations from means that it fitted: they come out too small.
    covariance: Floats = people / max(people - samples, 1.0) * fit.covariance
    if "scene" in crossed.shares:
        scale = steep**2 / (len(crossed.shares["scene"]) - 1.0)
        covariance[:conditions, :conditions] += scale * crossed.covariance("scene")
    return covariance


def _own(
    fit: PeopleFit, names: Sequence[str], participants: Sequence[str]
) -> dict[str, dict[str, float]]:
    """Return each participant's deviation of eta in the conditions that the participant saw."""
    return {
        name: {
            who: float(apart)
            for who, apart in zip(participants, fit.own[:, k], strict=True)
            if np.isfinite(apart)
        }
        for k, name in enumerate(names)
    }


def _not_told(
    population: Population, contrasts: Sequence[Difference], x: Floats, condition: Ints
) -> list[str]:
    """Return notes on thresholds outside the levels shown, and on pairs that are not compared."""
    names, place = population.names, population.places()
    outside = [
        name
        for k, name in enumerate(names)
        if not x[condition == k].min() <= place[k] <= x[condition == k].max()
    ]
    notes = [f"the threshold of {', '.join(outside)} lies outside the levels shown"] * bool(outside)
    compared = {(one.first, one.second) for one in contrasts}
    return notes + [
        f"thresholds of {first} and {second} are not compared: not identified by these data"
        for first, second in population.pairs
        if (first, second) not in compared
    ]


def _pooled(design: Floats, y: Floats, response: ResponseFunction) -> Floats:
    """Return the coefficients that fit best where all participants are alike."""
    rates = response.rates(response.start())
    ones = np.ones_like(y)

    def loss(beta: Floats) -> tuple[float, Floats]:
        eta = design @ beta
        value = -response.log_likelihood(eta, y, ones, rates) + 1e-3 * float(beta @ beta)
        return value, -design.T @ response.slope(eta, y, ones, rates)[0] + 2e-3 * beta

    # Performance may rise or fall with the level: a start on each side of flat.
    conditions_of = np.all((design == 0) | (design == 1), axis=0)
    starts = [np.where(conditions_of, 0.0, sign) for sign in (-1.0, 1.0)]
    found = [scipy.optimize.minimize(loss, start, jac=True, method="BFGS") for start in starts]
    return np.asarray(min(found, key=lambda one: float(one.fun)).x, dtype=np.float64)


def _kinds(groups: Mapping[str, Ints], condition: Ints) -> list[str]:
    """Return the random effects: of each group, and of each in one condition if it saw several."""
    return [
        name + where
        for name, code in groups.items()
        for where in (("",) if one_condition(code, condition) else ("", IN_CONDITION))
    ]


def _over_scenes(
    people: PeopleFit,
    design: Floats,
    y: Floats,
    groups: Mapping[str, Ints],
    condition: Ints,
    response: ResponseFunction,
    steepest: Floats,
) -> PeopleFit | None:
    """Return the model with scenes, too; None where no search finds a maximum."""
    person = groups["participant"]
    count = people.own.shape[1]
    kinds, codes = _kinds(groups, condition), []
    for kind in kinds:
        code = groups[kind.removesuffix(IN_CONDITION)]
        if kind.endswith(IN_CONDITION):
            code = np.unique(code * count + condition, return_inverse=True)[1].ravel()
        codes.append(code.astype(np.int64))
    if response.lapse is None:
        response = replace(response, lapse=people.lapses[person])
    known, others = np.maximum(people.sd, 0.1), np.ones(len(kinds) - people.sd.size)
    for sd in STARTS:
        begin = np.concatenate([people.beta, known, sd * others, response.start()])
        fit = fit_crossed(design, y, codes, response=response, start=begin, steepest=steepest)
        if fit.converged:
            break
    else:
        return None
    own = np.full(people.own.shape, np.nan)
    own[person, condition] = fit.random[0][person]
    if people.sd.size > 1:
        own[person, condition] += fit.random[1][codes[1]]
    # Lapse rates are those of the other model.
    size, rates = fit.covariance.shape[0], people.rates[response.fitted :]
    covariance = np.zeros((size + rates.size, size + rates.size))
    covariance[:size, :size] = fit.covariance
    if rates.size:
        covariance[size:, size:] = people.covariance[-rates.size :, -rates.size :]
    return replace(
        people,
        beta=fit.beta,
        sd=fit.sd,
        covariance=covariance,
        rates=np.concatenate([logit(2.0 * np.array([fit.guess] * response.fitted)), rates]),
        log_likelihood=fit.log_likelihood,
        converged=True,
        guess=fit.guess,
        own=own,
    )


def _notes(fit: PeopleFit, people: int) -> list[str]:
    notes = []
    if not fit.converged:
        notes.append("the model has no proper maximum: thresholds have no numbers")
    if people < FEW_PARTICIPANTS:
        notes.append(
            f"only {count_of(people, 'participant')}: limits of thresholds are a rough guide"
        )
    if fit.converged and fit.sd[0] < 1e-3:
        notes.append("no variance of thresholds between participants was found (sd 0)")
    return notes
