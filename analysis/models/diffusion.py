"""EZ diffusion: drift, boundary and non-decision time from accuracy and reaction times."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import scipy
from scipy.special import logit

from analysis.models.cells import checked, conditions
from analysis.models.contrasts import Difference, paired, pairs_of
from analysis.models.reaction import mean_with_limits

NOISE = 0.1
"""Within-trial noise s, as the papers scale it: drift and boundary are in units of it."""

FEWEST_RIGHT = 10
"""Right answers below which their variance, and so drift and boundary, is hardly known."""

MEASURES = ("drift", "boundary", "nondecision_s")


@dataclass(frozen=True)
class Diffusion:
    """The diffusion model of one person in one condition.

    Attributes
    ----------
    drift : float
        How fast evidence comes, per second; the sign is that of accuracy - 1/2.
    boundary : float
        How much evidence is asked for.
    nondecision_s : float
        Time for seeing and pressing, s; in results by condition NaN where it would be below 0.
    share, mean_s, variance_s2 : float
        What these follow from: share of right answers (an edge moved by half a trial), mean and
        variance of the times of right answers.
    corrected : bool
        The share was 0, 1/2 or 1, and was moved.
    """

    drift: float
    boundary: float
    nondecision_s: float
    share: float
    mean_s: float
    variance_s2: float
    corrected: bool


@dataclass(frozen=True)
class PersonDiffusion:
    """One participant's model in one condition."""

    participant: str
    condition: str
    trials: int
    fit: Diffusion


@dataclass(frozen=True)
class MeanDiffusion:
    """Means over participants of one condition, with t limits by measure."""

    condition: str
    participants: int
    means: dict[str, float]
    lower: dict[str, float]
    upper: dict[str, float]
    level: float


@dataclass(frozen=True)
class DiffusionResults:
    """EZ diffusion of all people and conditions, and what differs between conditions.

    `contrasts` are paired over participants; Holm-adjusted within each measure.
    """

    people: tuple[PersonDiffusion, ...]
    conditions: tuple[MeanDiffusion, ...]
    contrasts: tuple[Difference, ...]
    warnings: tuple[str, ...]


def ez_diffusion(
    share: float, variance_s2: float, mean_s: float, *, trials: int | None = None
) -> Diffusion:
    """Return drift, boundary and non-decision time in closed form.

    Parameters
    ----------
    share : float
        Of right answers among two, in [0, 1].
    variance_s2, mean_s : float
        Of the reaction times of right answers, s^2 and s.
    trials : int, optional
        How many answers there were: a share of 0, 1/2 or 1, at which the equations break down,
        moves by half of one. Needed for such a share.

    Raises
    ------
    ValueError
        If the share is not in [0, 1], variance or mean is not positive, or `trials` is missing.

    Notes
    -----
    Wagenmakers, van der Maas and Grasman 2007, Psychonomic Bulletin & Review 14, 3-22, equations
    5, 7 and 9. The start lies midway between the boundaries, and nothing varies from trial
    to trial.
    """
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"share must lie between 0 and 1 (got {share})")
    if not (variance_s2 > 0.0 and mean_s > 0.0):
        raise ValueError(
            f"variance and mean of times must be positive (got {variance_s2}, {mean_s})"
        )
    edge = share in (0.0, 0.5, 1.0)
    if edge:
        if trials is None:
            raise ValueError(f"trials must be given for a share of {share}: it is moved by half")
        share += (-0.5 if share == 1.0 else 0.5) / trials
    odds = float(logit(share))
    inner = odds * (odds * share**2 - odds * share + share - 0.5) / variance_s2
    drift = math.copysign(NOISE * inner**0.25, share - 0.5)
    boundary = NOISE**2 * odds / drift
    turn = math.exp(-drift * boundary / NOISE**2)
    decision_s = boundary / (2.0 * drift) * (1.0 - turn) / (1.0 + turn)
    return Diffusion(drift, boundary, mean_s - decision_s, share, mean_s, variance_s2, edge)


def diffusion_by_condition(
    trials: pd.DataFrame,
    by: Sequence[str] = (),
    *,
    reference: str | None = None,
    level: float = 0.95,
) -> DiffusionResults:
    """Fit EZ diffusion to each person in each condition, and compare conditions over people.

    Parameters
    ----------
    trials : DataFrame, one row per decided trial of a task with two answers
        ``participant``, ``correct`` (0/1), ``rt_s`` and the columns `by`; rows without a time are
        left out.
    reference : str, optional
        Condition that the others are compared with; left out, all pairs.

    Raises
    ------
    ValueError
        If columns are missing, or no person has times of two right answers.
    """
    rows = checked(trials, ("correct", "rt_s"), by)
    rows = rows[rows["rt_s"].notna()].reset_index(drop=True)
    if (rows["rt_s"] <= 0).any():
        raise ValueError("column 'rt_s' must hold times above 0 s")
    people: list[PersonDiffusion] = []
    notes: list[str] = []
    names = [name for name, _ in conditions(rows, by)] if len(rows) else []
    for name, part in conditions(rows, by) if len(rows) else []:
        for who, own in part.groupby("participant", sort=True):
            times = own.loc[own["correct"] == 1, "rt_s"].to_numpy(dtype=np.float64)
            if times.size < 2 or times.var(ddof=1) == 0.0:
                notes.append(f"{who}, {name}: fewer than two different times of right answers")
                continue
            fit = ez_diffusion(
                float(own["correct"].mean()),
                float(times.var(ddof=1)),
                float(times.mean()),
                trials=len(own),
            )
            notes += _odd(f"{who}, {name}", own, times, fit)
            if fit.nondecision_s <= 0.0:
                fit = replace(fit, nondecision_s=math.nan)
            people.append(PersonDiffusion(str(who), name, len(own), fit))
    if not people:
        raise ValueError("trials must hold times of two right answers of one person at least")
    return DiffusionResults(
        people=tuple(people),
        conditions=tuple(_mean(name, people, level) for name in names),
        contrasts=_contrasts(people, names, reference, level),
        warnings=tuple(notes),
    )


def _odd(who: str, own: pd.DataFrame, right: np.ndarray, fit: Diffusion) -> list[str]:
    """Return the evidence against the model, by the checks of the paper's section on misfit."""
    notes = []
    if right.size < FEWEST_RIGHT:
        notes.append(f"{who}: {right.size} right answers tell little of how times vary")
    if fit.nondecision_s <= 0.0:
        notes.append(
            f"{who}: no non-decision time (it would lie below 0): slow guesses or outliers among"
            " the times"
        )
    if right.size >= FEWEST_RIGHT and ((right - right.mean()) ** 3).mean() <= 0.0:
        notes.append(f"{who}: times are not skewed to the right, as a diffusion's are")
    wrong = own.loc[own["correct"] == 0, "rt_s"].to_numpy(dtype=np.float64)
    if wrong.size >= FEWEST_RIGHT and right.size >= FEWEST_RIGHT:
        p = float(scipy.stats.mannwhitneyu(right, wrong).pvalue)
        if p < 0.01:
            notes.append(f"{who}: right and wrong answers differ in speed; EZ takes them as alike")
    return notes


def _mean(name: str, people: Sequence[PersonDiffusion], level: float) -> MeanDiffusion:
    own = [one.fit for one in people if one.condition == name]
    means, lower, upper = {}, {}, {}
    for measure in MEASURES:
        values = np.array([getattr(fit, measure) for fit in own])
        least = 0.0 if measure == "boundary" else -math.inf
        means[measure], low, upper[measure] = mean_with_limits(values, level)
        lower[measure] = max(low, least)
    return MeanDiffusion(name, len(own), means, lower, upper, level)


def _contrasts(
    people: Sequence[PersonDiffusion], names: Sequence[str], reference: str | None, level: float
) -> tuple[Difference, ...]:
    pairs = pairs_of(names, reference)
    found: list[Difference] = []
    for measure in MEASURES:
        value = {(one.participant, one.condition): getattr(one.fit, measure) for one in people}
        gaps = []
        for first, second in pairs:
            both = [who for who, name in value if name == first and (who, second) in value]
            own = np.array([value[who, first] - value[who, second] for who in both])
            own = own[np.isfinite(own)]
            if own.size > 1 and own.std(ddof=1) > 0.0:
                gaps.append(((first, second), own))
        found += paired(measure, gaps, level)
    return tuple(found)
