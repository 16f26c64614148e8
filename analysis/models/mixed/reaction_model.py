"""Reaction times as a log-normal mixed model: what conditions change, over people and scenes."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from analysis.arrays import Floats, Ints
from analysis.models.cells import TrialGrid, checked, grid, numbered
from analysis.models.contrasts import (
    IN_CONDITION,
    CrossedDesign,
    Difference,
    absorbing,
    equal,
    pairs_of,
    ratio_p,
    wald,
    with_holm,
)
from analysis.models.mixed.inference import USUAL, Draws, Inference
from analysis.models.mixed.linear_mixed import LinearMixed, fit_linear_mixed
from analysis.models.mixed.marginal_means import NO_MARGINS, Asked, Margins, margins
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

    `ratio_p` is of the likelihood ratio against equal conditions, by the same t or by bootstrap.
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
    ratio_p: float = math.nan
    ratio_p_adjusted: float = math.nan


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
    `linear_mixed.fit_linear_mixed`. Limits and tests are t with degrees of freedom between those
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
    tested = with_holm(
        [
            _ratio_p(design, y, effects, fit, (names.index(gap.first), names.index(gap.second)),
                     gap.df, inference.draws)
            for gap in gaps
        ]
    )  # fmt: skip
    if people < FEW_PARTICIPANTS:
        notes.append(f"only {people} participants: limits and p are a rough guide")
    return TimeModel(
        times=tuple(
            ConditionTime(name, middle, low, high, len(part))
            for (name, part), own, to in zip(parts, beta, reach, strict=True)
            for middle, low, high in [np.exp([own, own - to, own + to]).tolist()]
        ),
        ratios=tuple(_time_ratio(gap, *own, level) for gap, own in zip(gaps, tested, strict=True)),
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


def _time_ratio(gap: Difference, own: float, together: float, level: float) -> TimeRatio:
    ratio, lower, upper = np.exp([gap.difference, gap.lower, gap.upper]).tolist()
    sides = gap.first, gap.second
    tested = gap.df, gap.p, gap.p_adjusted, gap.t, own, together
    return TimeRatio(*sides, ratio, lower, upper, level, *tested)


def _ratio(
    design: Floats,
    y: Floats,
    effects: Mapping[str, Ints],
    near: LinearMixed,
    pair: tuple[int, int],
) -> tuple[float, LinearMixed]:
    """Return the likelihood ratio of two equal conditions, and the model where they are one.

    `near`: where searches begin.
    """

    def best(design: Floats, contrast: float) -> LinearMixed:
        sd = {name: near.sd[name] / near.residual_sd for name in effects}
        starts = absorbing(sd, contrast / near.residual_sd)
        return fit_linear_mixed(design, y, effects, restricted=False, starts=starts)

    whole = best(design, 0.0)
    less = best(equal(design, pair), float(whole.beta[pair[0]] - whole.beta[pair[1]]))
    return max(0.0, 2.0 * (whole.log_likelihood - less.log_likelihood)), less


def _ratio_p(
    design: Floats,
    y: Floats,
    effects: Mapping[str, Ints],
    fit: LinearMixed,
    pair: tuple[int, int],
    df: float,
    draws: Draws | None,
) -> float:
    """Return p of that ratio, by t or by drawing times from the model where they are one."""
    observed, less = _ratio(design, y, effects, fit, pair)
    if draws is None:
        return ratio_p(observed, df)
    fixed = equal(design, pair) @ less.beta

    def drawn(rng: np.random.Generator) -> float:
        times = fixed + less.residual_sd * rng.standard_normal(y.size)
        for name, code in effects.items():
            times += less.sd[name] * rng.standard_normal(int(code.max()) + 1)[code]
        return _ratio(design, times, effects, less, pair)[0]

    return draws.p(observed, drawn)
