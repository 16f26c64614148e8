"""How much people and scenes differ in a task with right answers, from the decisions of a pilot."""

from collections.abc import Callable

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from analysis.cells import grid
from analysis.glmm import fit_crossed
from analysis.parts.sensitivity import with_shared_noise
from analysis.plans.rates import RateSettings, prepared
from analysis.power import NO_SPREAD, rough_guesses
from analysis.response import Response
from analysis.tasks.rates.power import COMMON
from analysis.thresholds import fit_thresholds
from protocols.errors import StudyError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TOO_NEAR = 0.05
"""Of a mean share to chance, or to 1: there d' says nothing of shares, or shares nothing of d'."""

assert COMMON == 0.5, "effects of both kinds below have one deviation"


def sensitivity_deviations(
    decisions: pd.DataFrame,
    settings: RateSettings,
    share: Callable[[Floats], Floats] | None,
) -> tuple[dict[str, float], list[str]]:
    """Estimate how much d' differs between participants, and between scenes.

    Parameters
    ----------
    share : callable, optional
        From d' to the chance of a right answer; None: yes-no, where the criterion differs too.

    Returns
    -------
    values : by name of the assumption
    notes

    Raises
    ------
    StudyError
        If there are fewer than three participants, or answers have no finite spread.

    Notes
    -----
    One mixed model (`glmm.fit_crossed`) with a mean for every condition, level and (yes-no) right
    answer. Participants,
    and scenes, deviate in all conditions alike and in each alone, with one deviation for both, as
    the simulation of power takes it. Yes-no: probit of the signal's answer, so that a slope on
    the signal is a deviation of d' and minus an intercept one of the criterion. Right answers:
    probit above chance; a deviation there becomes one of d' by the slope of `share` at the mean
    (to first order).
    """
    yes_no = share is None
    rows = prepared(decisions, settings)
    if yes_no:
        rows = with_shared_noise(rows, settings.answers[0])
    condition = _codes(rows["condition"])
    level = _codes(rows[settings.level]) if settings.level is not None else 0 * condition
    signal, y = np.ones(len(rows)), rows["correct"].to_numpy(dtype=np.float64)
    if yes_no:
        signal = np.where(rows["expected"].astype(str) == settings.answers[0], 0.5, -0.5)
        y = np.asarray(rows["answer"].astype(str) == settings.answers[0], dtype=np.float64)
    # A mean for each: where all answer alike there is no finite one.
    cell = _codes(pd.Series((condition * (level.max() + 1) + level) * 2 + (signal > 0)))
    keep = ~_unanimous(cell, y)
    if not keep.any():
        raise StudyError(NO_SPREAD)
    rows, y, signal = rows[keep].reset_index(drop=True), y[keep], signal[keep]
    condition, cell = _codes(rows["condition"]), _codes(pd.Series(cell[keep]))
    places = grid(rows)
    people, scenes = len(places.participants), len(places.scenes)
    if people < 3:
        raise StudyError(f"--from: must hold three participants at least (found {people})")
    design = (cell[:, None] == np.arange(cell.max() + 1)).astype(np.float64)
    groups, slopes, names = [], [], []
    for name, codes, times in (
        ("participant_sd", places.person, signal),
        ("scene_sd", places.scene, signal),
        ("criterion_sd", places.person, -np.ones(len(rows))),
    ):
        if (name == "scene_sd" and scenes < 2) or (name == "criterion_sd" and not yes_no):
            continue
        members = _members(codes, condition)
        groups.append(members)
        slopes.append(np.broadcast_to(times[:, None], members.shape))
        names.append(name)
    response = Response("probit", 0.0 if yes_no else settings.chance, 0.0)
    fit = fit_crossed(design, y, groups, response=response, slopes=slopes)
    if not fit.converged:
        raise StudyError(NO_SPREAD)
    # Two effects of one deviation each, where there are several conditions.
    whole = np.sqrt(1.0 / COMMON) if condition.max() > 0 else 1.0
    values = {name: whole * float(sd) for name, sd in zip(names, fit.sd, strict=True)}
    if share is not None:
        unit = _in_d_prime(fit.beta, np.bincount(cell), settings.chance, share)
        values = {name: unit * value for name, value in values.items()}
    return values, list(rough_guesses(people, scenes))


def threshold_deviations(
    decisions: pd.DataFrame, settings: RateSettings, span: float
) -> tuple[dict[str, float], list[str]]:
    """Estimate how much thresholds of adaptive levels differ, as shares of the levels' range.

    Raises
    ------
    StudyError
        If thresholds cannot be fitted.
    """
    rows = prepared(decisions, settings)
    logarithmic = settings.shape == "weibull"
    try:
        model = fit_thresholds(
            rows,
            str(settings.level),
            ("condition",),
            guess=settings.chance,
            shape=settings.shape,
            falling=settings.falling,
            logarithmic=logarithmic,
            scenes=False,
        )
    except ValueError as problem:
        raise StudyError(
            f"--from: deviations cannot be taken from this pilot ({problem}); give them by --set"
        ) from None
    typical = float(np.mean([one.value for one in model.thresholds])) if logarithmic else 1.0
    values = {
        "participant_sd": model.participant_sd * typical / span,
        "interaction_sd": model.interaction_sd * typical / span,
    }
    if not logarithmic:
        values["width"] = float(np.mean([abs(one.width) for one in model.thresholds])) / span
    if len(model.thresholds) == 1:
        del values["interaction_sd"]
    if not np.isfinite(list(values.values())).all():
        raise StudyError(NO_SPREAD)
    return values, list(rough_guesses(model.participants, 1))


def _members(codes: Ints, condition: Ints) -> Ints:
    """Return each trial's effects of a factor: in all conditions alike, and in this one alone."""
    if condition.max() == 0:
        return codes[:, None]
    own = np.unique(codes * (condition.max() + 1) + condition, return_inverse=True)[1].ravel()
    return np.column_stack([codes, codes.max() + 1 + own])


def _in_d_prime(
    eta: Floats, trials: Ints, chance: float, share: Callable[[Floats], Floats]
) -> float:
    """Return how far d' moves where a probit above chance moves by 1, at the mean of all cells."""
    response = Response("probit", chance, 0.0)
    rates = (chance, 0.0)
    right = float(response.share(eta, rates) @ trials / trials.sum())
    if min(right - chance, 1.0 - right) < TOO_NEAR:
        raise StudyError(
            "--from: right answers must lie between chance and always to tell how d' differs (the"
            f" pilot has {right:.3f}, chance is {chance:.3g}); give deviations by --set"
        )
    d_prime = np.linspace(0.0, 8.0, 1601)
    shares = share(d_prime)
    step = 1e-3
    etas = np.array(
        [response.eta((value - chance) / (1.0 - chance)) for value in (right - step, right + step)]
    )
    return float(
        np.diff(np.interp([right - step, right + step], shares, d_prime))[0] / np.diff(etas)[0]
    )


def _codes(column: pd.Series) -> Ints:
    return np.asarray(pd.factorize(column, sort=True)[0], dtype=np.int64)


def _unanimous(cell: Ints, y: Floats) -> NDArray[np.bool_]:
    """Say of each trial whether its cell was always answered alike: it has no finite mean."""
    share = np.bincount(cell, weights=y) / np.maximum(np.bincount(cell), 1)
    return np.asarray((share[cell] == 0.0) | (share[cell] == 1.0))
