"""Deviations between people and between scenes, from the decisions of a pilot."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from analysis.answers import codes_of
from analysis.arrays import Bools, Floats, Ints
from analysis.models.compared_methods import as_numbers
from analysis.models.contrasts import IN_CONDITION
from analysis.models.curves.response import LOGIT, ResponseFunction
from analysis.models.mixed.glmm import CrossedFit, fit_crossed
from analysis.models.mixed.reaction_model import time_model
from analysis.models.thresholds import fit_thresholds
from analysis.parts import AnalysisPlan
from analysis.parts.ratings import RatingsPart
from analysis.parts.sensitivity import with_shared_noise
from analysis.parts.times import TimesPart
from analysis.plans.rate_plan import RatePlan, prepared
from analysis.plans.rating_plan import RatingPlan
from protocols.errors import StudyError

Found = tuple[dict[str, float], tuple[str, ...]]
"""Deviations by name of the assumption, and notes."""

FEW_IN_PILOT = 12
"""Participants, or scenes, below which a deviation is a rough guess."""
TOO_NEAR = 0.05
"""Distance of a mean share from chance or 1, below which d' and shares say little of another."""
_CANNOT = "--from: deviations cannot be taken from this pilot ({}); give them by --set"
NO_SPREAD = _CANNOT.format(
    "nearly everyone always answers alike, so that they have no finite estimate"
)


def preference_deviations(decisions: pd.DataFrame) -> Found:
    """Estimate deviations on the logit of choices.

    Parameters
    ----------
    decisions : DataFrame, one row per decision
        Columns ``participant``, ``scene``, ``size``, ``first``, ``second``, ``chosen``.

    Returns
    -------
    values
        Without ``scene_sd`` where there is one scene, and without ``size_correlation`` where there
        is one size or nothing varies.
    notes

    Raises
    ------
    StudyError
        If there are fewer than three participants, or answers have no finite spread.

    Notes
    -----
    One logit mixed model (`glmm.fit_crossed`): a mean for every pairing and size, order, and
    deviations of each participant and each scene in a pairing, at all sizes alike and at one size
    alone. The correlation between sizes is the share of variance that sizes have in common.
    A pairing at a size where all answers agree has no finite mean, and is left out.
    """
    rows = as_numbers(decisions)
    first, second = (rows[side].cat.codes.to_numpy(dtype=np.int64) for side in ("first", "second"))
    low = np.minimum(first, second)
    y = np.asarray(rows["chosen"].cat.codes.to_numpy() == low, dtype=np.float64)
    cell = codes_of(low, np.maximum(first, second), rows["size"])
    keep = _undecided(cell, y)
    if not keep.any():
        raise StudyError(_CANNOT.format("everyone answers alike in every comparison"))
    rows, y, first, second, low = rows[keep], y[keep], first[keep], second[keep], low[keep]
    pairing = codes_of(low, np.maximum(first, second))
    cell, sizes = codes_of(pairing, rows["size"]), rows["size"].nunique()
    order = [np.where(first == low, 0.5, -0.5)] if np.unique(first == low).size > 1 else []
    people, scenes = _counted(rows)
    kinds = [pairing] if sizes == 1 else [pairing, cell]
    names = ["participant", "scene"] if scenes > 1 else ["participant"]
    groups = [codes_of(rows[name].astype(str), kind) for name in names for kind in kinds]
    fit = _fitted(cell, order, y, groups)
    variance = (fit.sd**2).reshape(len(names), len(kinds))
    values = {
        f"{name}_sd": float(sd) for name, sd in zip(names, np.sqrt(variance.sum(1)), strict=True)
    }
    if sizes > 1 and variance.sum() > 0:
        values["size_correlation"] = float(variance[:, 0].sum() / variance.sum())
    return values, rough_guesses(people, scenes)


def sensitivity_deviations(
    decisions: pd.DataFrame,
    plan: RatePlan,
    share: Callable[[Floats], Floats] | None,
) -> Found:
    """Estimate how much d' differs between participants, and between scenes.

    Parameters
    ----------
    share : callable, optional
        From d' to the chance of a right answer; None: yes-no, where the criterion differs too.

    Raises
    ------
    StudyError
        If there are fewer than three participants, or answers have no finite spread.

    Notes
    -----
    One mixed model (`glmm.fit_crossed`) with a mean for every condition, level and (yes-no) right
    answer. Participants,
    and scenes, deviate in all conditions alike and in each alone, with one deviation for both, as
    the simulation of power takes it (`simulations.COMMON`). Yes-no: probit of the signal's answer,
    so that a slope on the signal is a deviation of d' and minus an intercept one of the criterion.
    Right answers: probit above chance; a deviation there becomes one of d' by the slope of `share`
    at the mean (to first order).
    """
    yes_no, first = share is None, next(iter(plan.answers), "")
    rows = prepared(decisions, plan)
    rows = with_shared_noise(rows, first) if yes_no else rows
    signal, y = np.ones(len(rows)), rows["correct"].to_numpy(dtype=np.float64)
    if yes_no:
        signal = np.where(rows["expected"].astype(str) == first, 0.5, -0.5)
        y = np.asarray(rows["answer"].astype(str) == first, dtype=np.float64)
    level = [] if plan.level is None else [rows[plan.level]]
    cell = codes_of(rows["condition"], *level, signal)
    # A mean for each: where all answer alike there is no finite one.
    keep = _undecided(cell, y)
    if not keep.any():
        raise StudyError(NO_SPREAD)
    rows, y, signal, cell = rows[keep], y[keep], signal[keep], codes_of(cell[keep])
    people, scenes = _counted(rows)
    conditions = rows["condition"].nunique()
    times = {"participant_sd": signal}
    times |= {"scene_sd": signal} if scenes > 1 else {}
    times |= {"criterion_sd": -np.ones(len(rows))} if yes_no else {}
    groups, slopes = [], []
    for name, one in times.items():
        whole = codes_of(rows["scene" if name == "scene_sd" else "participant"].astype(str))
        own = [] if conditions == 1 else [whole.max() + 1 + codes_of(whole, rows["condition"])]
        groups.append(np.column_stack([whole, *own]))
        slopes.append(np.broadcast_to(one[:, None], groups[-1].shape))
    response = ResponseFunction("probit", 0.0 if yes_no else plan.chance, 0.0)
    fit = _fitted(cell, [], y, groups, slopes, response)
    # Two effects of one deviation each, where there are several conditions.
    unit = np.sqrt(2.0) if conditions > 1 else 1.0
    if share is not None:
        unit *= _in_d_prime(fit.beta, np.bincount(cell), plan.chance, share)
    values = {name: float(unit * sd) for name, sd in zip(times, fit.sd, strict=True)}
    return values, rough_guesses(people, scenes)


def threshold_deviations(decisions: pd.DataFrame, plan: RatePlan, span: float) -> Found:
    """Estimate how much thresholds of adaptive levels differ, as shares of the levels' range.

    Raises
    ------
    StudyError
        If thresholds cannot be fitted.
    """
    try:
        model = fit_thresholds(
            prepared(decisions, plan),
            str(plan.level),
            ("condition",),
            replace(plan.curve, guess=plan.chance),
        )
    except ValueError as problem:
        raise StudyError(_CANNOT.format(problem)) from None
    each = model.thresholds
    typical = float(np.mean([one.value for one in each])) if model.logarithmic else 1.0
    values = {"participant_sd": model.participant_sd * typical / span}
    if len(each) > 1:
        values["interaction_sd"] = model.interaction_sd * typical / span
    if not model.logarithmic:
        values["width"] = float(np.mean([abs(one.width) for one in each])) / span
    if not np.isfinite(list(values.values())).all():
        raise StudyError(NO_SPREAD)
    return values, rough_guesses(model.participants, 1)


def rating_deviations(decisions: pd.DataFrame, plan: RatingPlan) -> Found:
    """Estimate how much participants, and scenes, differ on the latent axis of ratings.

    Raises
    ------
    StudyError
        If the model cannot be fitted, or has no finite deviations.
    """
    try:
        sd = RatingsPart().of(decisions, plan).model.sd
    except ValueError as problem:
        raise StudyError(_CANNOT.format(problem)) from None
    values = {
        f"{name}_sd": float(np.hypot(sd.get(name, 0.0), sd.get(name + IN_CONDITION, 0.0)))
        for name in ("participant", "scene")
        if name in sd or name + IN_CONDITION in sd
    }
    if not np.isfinite(list(values.values())).all():
        raise StudyError(NO_SPREAD)
    return values, rough_guesses(*_counted(decisions))


def time_deviations(found: Found, decisions: pd.DataFrame, plan: AnalysisPlan) -> Found:
    """Add deviations of the logarithms of a pilot's reaction times to others; or a note why not."""
    values, notes = found
    times = TimesPart()
    try:
        if not times.wanted(decisions, plan):
            raise ValueError("it holds none")
        model = time_model(decisions[decisions["rt_s"] > 0], plan.compared)
    except ValueError as problem:
        why = (
            f"--from: no deviations of reaction times could be had ({problem}); give them by --set"
        )
        return values, (*notes, why)
    own = {
        "rt_participant_sd": np.hypot(model.participant_sd, model.interaction_sd),
        "rt_scene_sd": np.hypot(model.scene_sd, model.scene_interaction_sd),
        "rt_sd": model.residual_sd,
    }
    return values | {name: float(sd) for name, sd in own.items()}, notes


def rough_guesses(people: int, scenes: int) -> tuple[str, ...]:
    """Return notes on deviations for which a pilot has too few participants, or scenes."""
    return tuple(
        f"only {count} {kind} in the pilot: their deviation is a rough guess, and too small rather"
        " than too large; try larger ones by --set"
        for kind, count in (("participants", people), ("scenes", scenes))
        if 1 < count < FEW_IN_PILOT
    )


def _counted(rows: pd.DataFrame) -> tuple[int, int]:
    """Return the numbers of participants and of scenes; three people at least."""
    people = rows["participant"].astype(str).nunique()
    if people < 3:
        raise StudyError(f"--from: must hold three participants at least (found {people})")
    return people, rows["scene"].astype(str).nunique() if "scene" in rows else 1


def _fitted(
    cell: Ints,
    further: Sequence[Floats],
    y: Floats,
    groups: Sequence[Ints],
    slopes: Sequence[Floats] = (),
    response: ResponseFunction = LOGIT,
) -> CrossedFit:
    """Fit a mean for every cell, and further coefficients."""
    means = (cell[:, None] == np.arange(cell.max() + 1)).astype(np.float64)
    design = np.column_stack([means, *further])
    fit = fit_crossed(design, y, groups, response=response, slopes=slopes)
    if not fit.converged:
        raise StudyError(NO_SPREAD)
    return fit


def _in_d_prime(
    eta: Floats, trials: Ints, chance: float, share: Callable[[Floats], Floats]
) -> float:
    """Return the change of d' where a probit above chance moves by 1, at the mean of all cells."""
    response = ResponseFunction("probit", chance, 0.0)
    right = float(response.share(eta, (chance, 0.0)) @ trials / trials.sum())
    if min(right - chance, 1.0 - right) < TOO_NEAR:
        raise StudyError(
            "--from: right answers must lie between chance and always to tell how d' differs (the"
            f" pilot has {right:.3f}, chance is {chance:.3g}); give deviations by --set"
        )
    d_prime = np.linspace(0.0, 8.0, 1601)
    near = np.array([right - 1e-3, right + 1e-3])
    etas = [response.eta((value - chance) / (1.0 - chance)) for value in near]
    return float(np.diff(np.interp(near, share(d_prime), d_prime))[0] / np.diff(etas)[0])


def _undecided(cell: Ints, y: Floats) -> Bools:
    """Say of each trial whether answers in its cell differ: else it has no finite mean."""
    share = np.bincount(cell, weights=y) / np.maximum(np.bincount(cell), 1)
    return np.asarray((share[cell] > 0.0) & (share[cell] < 1.0))
