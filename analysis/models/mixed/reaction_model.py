"""Reaction times as a log-normal mixed model: what conditions change, over people and scenes."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from analysis.arrays import Floats, Ints
from analysis.models.cells import TrialGrid, checked, grid, numbered
from analysis.models.contrasts import (
    IN_CONDITION,
    MOST_IN_PAIRS,
    CrossedDesign,
    Difference,
    holm_where_known,
    pairs_of,
    wald,
)
from analysis.models.mixed.inference import USUAL, Inference
from analysis.models.mixed.linear_mixed import LinearMixed, fit_linear_mixed
from analysis.models.mixed.marginal_means import NO_MARGINS, Asked, Margins, margins
from analysis.models.mixed.profile import absorbing, ratio_test
from analysis.models.numeric import two_sided_quantile
from analysis.models.right_answers import FEW_PARTICIPANTS

NO_SPREAD = 1e-3
"""Deviation of ln s below which there is none."""


@dataclass(frozen=True)
class ConditionTime:
    """The typical time of a condition, s: the median person's median answer."""

    condition: str
    median_s: float
    lower: float
    upper: float
    answers: int


@dataclass(frozen=True)
class TimeRatio:
    """Ratio of the times that answers take in two conditions, first to second; p tests 1.

    p is of the likelihood ratio against equal conditions, whose signed root is `t`, by t or by
    bootstrap; limits are those of the profile likelihood.
    """

    first: str
    second: str
    ratio: float
    lower: float
    upper: float
    level: float
    df: float
    p: float
    p_adjusted: float
    t: float


@dataclass(frozen=True)
class TimeModel:
    """Logarithms of reaction times as a linear mixed model.

    Attributes
    ----------
    times, ratios
        By condition, and between conditions.
    beta, beta_se : tuple of float
        Mean logarithm of each condition, in the order of `times`.
    participant_sd, interaction_sd, scene_sd, scene_interaction_sd, residual_sd : float
        Of ln s: between people, of a person's deviation in a condition, between scenes, of a
        scene's deviation in a condition, the rest.
    sd : mapping
        The same by name of the effect, those of the model alone.
    log_likelihood : float
        Restricted (REML).
    """

    times: tuple[ConditionTime, ...]
    ratios: tuple[TimeRatio, ...]
    beta: tuple[float, ...]
    beta_se: tuple[float, ...]
    participant_sd: float
    interaction_sd: float
    scene_sd: float
    scene_interaction_sd: float
    residual_sd: float
    log_likelihood: float
    level: float
    answers: int
    participants: int
    scenes: int
    warnings: tuple[str, ...]
    margins: Margins = NO_MARGINS
    sd: Mapping[str, float] = field(default_factory=dict)


def time_model(
    trials: pd.DataFrame,
    by: Sequence[str] = (),
    *,
    reference: str | None = None,
    asked: Asked | None = None,
    inference: Inference = USUAL,
) -> TimeModel:
    """Fit ln(rt) = condition, random over participants and scenes, and both in a condition.

    Parameters
    ----------
    trials : DataFrame, one row per decided trial
        ``participant``, ``rt_s``, optionally ``scene``, and the columns `by`; rows without a time
        are left out.
    reference : str, optional
        Condition that the others are compared with; left out, all pairs.
    asked : mapping of name to weights of conditions, optional
        Contrasts of mean logarithms, in `TimeModel.margins`.

    Raises
    ------
    ValueError
        If columns are missing, times are not positive, or there are fewer than two people.

    Notes
    -----
    `linear_mixed.fit_linear_mixed`. Limits and tests of times are t, those of ratios
    the likelihood ratio's root by t, with degrees of freedom between those
    of participants and of scenes (`contrasts.CrossedDesign`): so many people and scenes, and not
    so many answers, tell what holds for others. The deviations of participants and scenes in a
    condition keep one person's taste, and one scene's, from passing for the condition's; where each
    has one time of a condition they are part of the residual, and where each has one condition
    there are none.
    """
    rows, places = _with_times(trials, by)
    people = len(places.participants)
    parts, condition = numbered(rows, by)
    names = [name for name, _ in parts]
    pairs = pairs_of(names, reference)
    design = (condition[:, None] == np.arange(len(names))).astype(np.float64)
    groups = places.several
    effects = groups | (places.in_conditions(condition) if len(names) > 1 else {})
    y = np.log(rows["rt_s"].to_numpy(dtype=np.float64))
    if design.shape[1] + len(effects) >= len(rows):
        raise ValueError(f"trials must hold more times than the model has numbers ({len(rows)})")
    fit = fit_linear_mixed(design, y, effects)
    level, beta, covariance, sd = inference.level, fit.beta, fit.covariance, fit.sd
    notes = [
        f"no variance between {kind} was found (sd 0)"
        for kind, name in (("participants", "participant"), ("scenes", "scene"))
        if name in sd and sd[name] < NO_SPREAD
    ]
    crossed = CrossedDesign.of(condition, groups, sd)
    error = np.sqrt(np.diag(covariance))
    df = [crossed.df(unit, own**2) for unit, own in zip(np.eye(len(names)), error, strict=True)]
    reach = two_sided_quantile(level, df) * error
    gaps = wald("ln s", names, pairs, beta, covariance, crossed=crossed, level=level)
    many = len(names) > MOST_IN_PAIRS
    likeliest = fit if many or not gaps else _likeliest(design, y, effects, fit)
    tested = [
        _by_wald(gap)
        if many
        else _time_ratio(
            _HeldGap(design, y, effects, likeliest,
                     (names.index(gap.first), names.index(gap.second))),
            gap, inference,
        )
        for gap in gaps
    ]  # fmt: skip
    if people < FEW_PARTICIPANTS:
        notes.append(f"only {people} participants: limits and p are a rough guide")
    return TimeModel(
        times=tuple(
            ConditionTime(name, middle, low, high, len(part))
            for (name, part), own, to in zip(parts, beta, reach, strict=True)
            for middle, low, high in [np.exp([own, own - to, own + to]).tolist()]
        ),
        ratios=tuple(
            replace(one, p_adjusted=own)
            for one, own in zip(tested, holm_where_known([one.p for one in tested]), strict=True)
        ),
        beta=tuple(map(float, beta)),
        beta_se=tuple(map(float, error)),
        participant_sd=sd["participant"],
        interaction_sd=sd.get("participant" + IN_CONDITION, 0.0),
        scene_sd=sd.get("scene", 0.0),
        scene_interaction_sd=sd.get("scene" + IN_CONDITION, 0.0),
        residual_sd=fit.residual_sd,
        log_likelihood=fit.log_likelihood,
        level=level,
        answers=len(rows),
        participants=people,
        scenes=len(places.scenes),
        warnings=tuple(notes),
        sd=sd,
        margins=margins(
            names, np.eye(len(names)), beta, covariance, crossed.df, level=level, asked=asked or {}
        ),
    )


def _with_times(trials: pd.DataFrame, by: Sequence[str]) -> tuple[pd.DataFrame, TrialGrid]:
    rows = checked(trials, ("rt_s",), by)
    rows = rows[rows["rt_s"].notna()].reset_index(drop=True)
    if rows.empty or (rows["rt_s"] <= 0).any():
        raise ValueError("column 'rt_s' must hold times above 0 s")
    places = grid(rows)
    if len(places.participants) < 2:
        found = len(places.participants)
        raise ValueError(f"trials must hold two participants at least (found {found})")
    return rows, places


@dataclass(frozen=True)
class _HeldGap:
    """The likelihood of logarithms of times where the gap of two conditions is held."""

    design: Floats
    y: Floats
    effects: Mapping[str, Ints]
    near: LinearMixed
    pair: tuple[int, int]

    def at(self, gap: float) -> LinearMixed:
        """Fit all else; searches begin near `near`."""
        first, second = self.pair
        missing = float(self.near.beta[first] - self.near.beta[second]) - gap
        return _likeliest(
            self.together(), self.y - gap * self.design[:, first], self.effects, self.near, missing
        )

    def together(self) -> Floats:
        """Return the design (rows, conditions - 1) with the two conditions as one."""
        first, second = sorted(self.pair)
        together = self.design.copy()
        together[:, first] += together[:, second]
        return np.delete(together, second, axis=1)


def _time_ratio(held: _HeldGap, gap: Difference, inference: Inference) -> TimeRatio:
    """Return a gap, judged by t or by drawing times from the model where it is 0."""

    def drawn(rng: np.random.Generator) -> float:
        times = held.together() @ less.beta
        times = times + less.residual_sd * rng.standard_normal(times.size)
        for name, code in held.effects.items():
            times += less.sd[name] * rng.standard_normal(int(code.max()) + 1)[code]
        study = replace(held, y=times, near=_likeliest(held.design, times, held.effects, less))
        return max(2.0 * (study.near.log_likelihood - study.at(0.0).log_likelihood), 0.0)

    draws = None
    if inference.draws is not None:
        less = held.at(0.0)
        draws = inference.draws.ratios(drawn)
    found = ratio_test(
        lambda value: held.at(value).log_likelihood, held.near.log_likelihood,
        gap.difference, gap.standard_error, gap.df, inference.level, draws,
    )  # fmt: skip
    judged = replace(gap, lower=found.lower, upper=found.upper, p=found.p)
    return replace(_by_wald(judged), t=found.root)


def _by_wald(gap: Difference) -> TimeRatio:
    ratio, lower, upper = np.exp([gap.difference, gap.lower, gap.upper]).tolist()
    tested = gap.df, gap.p, gap.p_adjusted, gap.t
    return TimeRatio(gap.first, gap.second, ratio, lower, upper, gap.level, *tested)


def _likeliest(
    design: Floats, y: Floats, effects: Mapping[str, Ints], near: LinearMixed, missing: float = 0.0
) -> LinearMixed:
    """Fit by the likelihood itself, whose ratios compare models; a gap is missing in the design."""
    names = list(effects)
    sd = np.array([near.sd[name] for name in names]) / near.residual_sd
    takers = [place for place, name in enumerate(names) if name.endswith(IN_CONDITION)]
    begins = absorbing(sd, missing / near.residual_sd / math.sqrt(2.0), takers)
    starts = [dict(zip(names, begin.tolist(), strict=True)) for begin in begins]
    return fit_linear_mixed(design, y, effects, restricted=False, starts=starts)
