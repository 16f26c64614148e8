"""Thresholds by condition with participants (and scenes) as random: one model of all trials."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import optimize, stats

from analysis.models.cells import checked, grid, numbered
from analysis.models.contrasts import IN_CONDITION, Crossed, Difference, pairs_of, wald
from analysis.models.glmm import fit_crossed
from analysis.models.psychometric import LINKS, SKEWED
from analysis.models.quadrature import STARTS, PeopleFit, fit_people
from analysis.models.response import Response, axis_of
from protocols.adaptive.levels import Shape
from protocols.adaptive.psychometric import WIDTH_EDGE
from protocols.prose import count_of

Floats = NDArray[np.float64]

Codes = NDArray[np.int64]

FEW_PARTICIPANTS = 5

OPEN_RANGES = 5.0
"""A limit outside the levels shown by more than so many of their ranges bounds nothing."""

NARROWEST = 0.9
"""Of the least gap between two levels: no answers at these tell a curve from a narrower one."""


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
        """Return whether the answers place it: with limits, not far outside the levels shown.

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
class ThresholdModel:
    """Psychometric functions of all conditions, fitted together.

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

    def __getitem__(self, condition: str) -> Threshold:
        return {one.condition: one for one in self.thresholds}[condition]

    def curve(self, condition: str, x: Floats) -> Floats:
        """Return the chance of a right answer of the typical participant at levels `x`."""
        one = self[condition]
        return np.asarray(self._curve(one, np.array([one.value]), x)[0])

    def average(self, condition: str, x: Floats) -> Floats:
        """Return the mean of the participants' chances at `x`: what all answers together follow."""
        one = self[condition]
        return np.asarray(self._curve(one, np.array(list(one.individual.values())), x).mean(axis=0))

    def _curve(self, one: Threshold, values: Floats, x: Floats) -> Floats:
        mirrored = self.falling and self.shape in SKEWED
        response = Response(LINKS[self.shape], self.guess, self.lapse, mirrored)
        gap = axis_of(x, self.logarithmic) - axis_of(values, self.logarithmic)[:, None]
        width = np.sign(one.width) * np.log(abs(one.width)) if self.logarithmic else one.width
        return response.share(gap * _span(response) / width, (self.guess, self.lapse))


def fit_thresholds(
    trials: pd.DataFrame,
    level_column: str,
    by: Sequence[str] = (),
    *,
    guess: float | None = 0.5,
    lapse: float | None = None,
    shape: Shape = "gauss",
    falling: bool = False,
    logarithmic: bool = False,
    own_widths: bool = False,
    scenes: bool = False,
    correct: str = "correct",
    reference: str | None = None,
    level: float = 0.95,
) -> ThresholdModel:
    """Fit psychometric functions whose thresholds vary between participants.

    Parameters
    ----------
    trials : DataFrame, one row per decided trial
        ``participant``, `level_column` (a number), `correct` (0/1), the columns `by`.
    guess, lapse : float or None
        Rates that are known; None fits them, drawn towards small ones (`response.RATE_PRIOR`).
    falling : bool
        Performance falls with the level. It matters for ``gumbel`` and ``weibull``, whose falling
        function is 1 - S, as the adaptive rules have it; the slope is free all the same.
    logarithmic : bool
        Thresholds vary, and the curve is symmetric, on the logarithm of the level. Needed for
        ``weibull``.
    own_widths : bool
        Each condition has its own width; else all share one.
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
    participants, and between these and those of scenes (`contrasts.Crossed`), because so many
    people and scenes, and not so many trials, tell the mean.
    """
    rows = checked(trials, (level_column, correct), by)
    raw = pd.to_numeric(rows[level_column], errors="coerce").to_numpy(dtype=np.float64)
    if not np.all(np.isfinite(raw)):
        raise ValueError(f"column {level_column!r} must hold numbers, in every row")
    if not rows[correct].isin((0, 1)).all():
        raise ValueError(f"column {correct!r} must hold 0 and 1 only, in every row")
    if shape == "weibull" and not logarithmic:
        raise ValueError("the Weibull function needs logarithmic=True")
    if logarithmic and np.any(raw <= 0):
        raise ValueError(f"column {level_column!r} must be positive to have a logarithm")
    places = grid(rows)
    if len(places.participants) < 2 or np.unique(raw).size < 2:
        raise ValueError(
            "trials must hold two participants and two levels at least"
            f" (found {len(places.participants)} and {np.unique(raw).size})"
        )
    x = axis_of(raw, logarithmic)
    centre, spread = float(x.mean()), float(x.std())
    parts, condition = numbered(rows, by)
    names = [name for name, _ in parts]
    pairs = pairs_of(names, reference)
    place = (condition[:, None] == np.arange(len(names))).astype(np.float64)
    scaled = (x - centre) / spread
    steep = place * scaled[:, None] if own_widths else scaled[:, None]
    design = np.column_stack([place, steep])
    response = Response(LINKS[shape], guess, lapse, falling and shape in SKEWED)
    y = rows[correct].to_numpy(dtype=np.float64)
    gap = float(np.diff(np.unique(scaled)).min())
    steepest = np.full(design.shape[1], np.inf)
    steepest[len(names) :] = _span(response) / (NARROWEST * gap)
    start = _pooled(design, y, response)
    person = places.person
    fit = fit_people(
        design, y, person, condition, response=response, start=start, steepest=steepest
    )
    groups = places.several if scenes else {"participant": person}
    over_scenes = None
    if len(groups) > 1:
        over_scenes = _over_scenes(fit, design, y, groups, condition, response, steepest)
        fit = over_scenes or fit
    kinds = _kinds(groups, len(names))
    slopes = np.broadcast_to(fit.beta[len(names) :], len(names))
    notes = _notes(fit, slopes, len(places.participants))
    if len(groups) > 1 and over_scenes is None and fit.converged:
        groups = {"participant": person}
        notes.append("no model of scenes could be fitted: thresholds are about these scenes")
    place_of = centre - spread * fit.beta[: len(names)] / slopes
    gradient = _gradient(fit.beta, len(names), own_widths, fit.covariance.shape[0]) * spread
    # Likelihood takes deviations from a mean that it fitted: they come out too small.
    people = len(places.participants)
    covariance = gradient @ fit.covariance @ gradient.T * people / (people - 1.0)
    typical = float(np.mean(np.abs(slopes)))
    sd = dict(zip(kinds, (fit.sd * spread / typical).tolist(), strict=False))
    crossed = Crossed.of(condition, groups, sd)
    error = np.sqrt(np.diag(covariance).clip(min=0))
    df = [crossed.df(unit, own**2) for unit, own in zip(np.eye(len(names)), error, strict=True)]
    reach = stats.t.ppf(0.5 + 0.5 * level, df) * error
    ends = (place_of - reach, place_of + reach) if fit.converged else None
    back = _risen if logarithmic else np.asarray
    widths = _span(response) * spread / slopes
    fitted = tuple(
        Threshold(
            condition=name,
            value=float(back(place_of[k])),
            lower=None if ends is None else float(back(ends[0][k])),
            upper=None if ends is None else float(back(ends[1][k])),
            width=float(np.sign(widths[k]) * back(abs(widths[k])) if logarithmic else widths[k]),
            individual={
                who: float(back(place_of[k] - spread * fit.own[i, k] / slopes[k]))
                for i, who in enumerate(places.participants)
                if np.isfinite(fit.own[i, k])
            },
        )
        for k, name in enumerate(names)
    )
    outside = [
        name
        for k, name in enumerate(names)
        if not x[condition == k].min() <= place_of[k] <= x[condition == k].max()
    ]
    if outside:
        notes.append(f"the threshold of {', '.join(outside)} lies outside the levels shown")
    shown = [float(value) for value in rows[level_column].unique()]
    found = tuple(one if one.identified(shown) else _unplaced(one.condition) for one in fitted)
    placed = {one.condition for one in found if not np.isnan(one.value)}
    contrasts = []
    measure = "ln threshold" if logarithmic else "threshold"
    for told in wald(measure, names, pairs, place_of, covariance, crossed=crossed, level=level):
        if {told.first, told.second} <= placed:
            contrasts.append(told)
        else:
            notes.append(
                f"thresholds of {told.first} and {told.second} are not compared: not identified by"
                " these data"
            )
    if not fit.converged or not placed:
        sd = dict.fromkeys(sd, np.nan)
    return ThresholdModel(
        shape=shape,
        falling=falling,
        logarithmic=logarithmic,
        thresholds=found,
        contrasts=tuple(contrasts),
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
    )


def _risen(logarithm: Floats) -> Floats:
    """Return the level of a logarithm; one too far out to be a number is infinite."""
    with np.errstate(over="ignore"):
        return np.asarray(np.exp(logarithm))


def _unplaced(condition: str) -> Threshold:
    return Threshold(condition, np.nan, None, None, np.nan, {})


def _span(response: Response) -> float:
    """Return how far eta goes while F rises from 5 to 95 %."""
    return response.eta(1.0 - WIDTH_EDGE) - response.eta(WIDTH_EDGE)


def _pooled(design: Floats, y: Floats, response: Response) -> Floats:
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
    found = [optimize.minimize(loss, start, jac=True, method="BFGS") for start in starts]
    return np.asarray(min(found, key=lambda one: float(one.fun)).x, dtype=np.float64)


def _gradient(beta: Floats, count: int, own_widths: bool, size: int) -> Floats:
    """Return derivatives of -intercept / slope in all parameters (conditions, parameters)."""
    gradient = np.zeros((count, size))
    for k in range(count):
        at = count + (k if own_widths else 0)
        gradient[k, k] = -1.0 / beta[at]
        gradient[k, at] = beta[k] / beta[at] ** 2
    return gradient


def _kinds(groups: Mapping[str, Codes], conditions: int) -> list[str]:
    """Return the random effects: of each group, and of each in one condition."""
    return [
        name + where
        for name in groups
        for where in (("", IN_CONDITION) if conditions > 1 else ("",))
    ]


def _over_scenes(
    people: PeopleFit,
    design: Floats,
    y: Floats,
    groups: Mapping[str, Codes],
    condition: Codes,
    response: Response,
    steepest: Floats,
) -> PeopleFit | None:
    """Return the model with scenes, too; None where no search finds a maximum."""
    person = groups["participant"]
    count = people.own.shape[1]
    codes = []
    for kind in _kinds(groups, count):
        code = groups[kind.removesuffix(IN_CONDITION)]
        if kind.endswith(IN_CONDITION):
            code = np.unique(code * count + condition, return_inverse=True)[1].ravel()
        codes.append(code.astype(np.int64))
    if response.lapse is None:
        response = replace(response, lapse=people.lapses[person])
    for sd in STARTS:
        deviations = np.concatenate([np.maximum(people.sd, 0.1), np.full(people.sd.size, sd)])
        begin = np.concatenate([people.beta, deviations, response.start()])
        fit = fit_crossed(design, y, codes, response=response, start=begin, steepest=steepest)
        if fit.converged:
            break
    else:
        return None
    own = np.full(people.own.shape, np.nan)
    own[person, condition] = fit.random[0][person]
    if count > 1:
        own[person, condition] += fit.random[1][codes[1]]
    return replace(
        people,
        beta=fit.beta,
        sd=fit.sd,
        covariance=fit.covariance,
        log_likelihood=fit.log_likelihood,
        converged=True,
        guess=fit.guess,
        own=own,
    )


def _notes(fit: PeopleFit, slopes: Floats, people: int) -> list[str]:
    notes = []
    if not fit.converged:
        notes.append("the model has no proper maximum: thresholds have no numbers")
    if people < FEW_PARTICIPANTS:
        notes.append(
            f"only {count_of(people, 'participant')}: limits of thresholds are a rough guide"
        )
    if np.unique(np.sign(slopes)).size > 1:
        notes.append("performance rises with the level in some conditions and falls in others")
    if fit.converged and fit.sd[0] < 1e-3:
        notes.append("no variance of thresholds between participants was found (sd 0)")
    return notes
