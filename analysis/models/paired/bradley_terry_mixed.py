"""One mixed model of all pairings: each person, and each scene, has own tastes of the methods."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pandas as pd

from analysis.arrays import Floats
from analysis.models.clustered import holm
from analysis.models.mixed.deviations import Deviation
from analysis.models.mixed.formula import group_codes
from analysis.models.mixed.glmm import (
    SINGULAR_SD,
    CrossedFit,
    crossed_deviations,
    fit_crossed,
    reduced_ratio,
)
from analysis.models.numeric import two_sided_p
from analysis.models.paired.paired_counts import components, has_maximum

FEW_METHODS = 3
"""Up to so many a second search finds more at times (5 of 72 contrasts; above, none of 306)."""


@dataclass(frozen=True)
class PairedContrast:
    """Log odds of choosing `first` over `second`, for the typical person and scene.

    Attributes
    ----------
    estimate, standard_error : float
        Log odds, whichever was shown first.
    ratio : float
        Likelihood ratio against equal methods (twice the difference of log-likelihoods).
    p, p_adjusted : float
        sqrt(ratio) against t of participants - 1; Holm's over the model's contrasts.
    """

    first: str
    second: str
    estimate: float
    standard_error: float
    ratio: float
    p: float
    p_adjusted: float


@dataclass(frozen=True)
class PairedModel:
    """Bradley and Terry's model with random tastes.

    Attributes
    ----------
    contrasts : tuple of PairedContrast
        Every two methods that were compared; none where the likelihood has no finite maximum.
    shown_first, shown_first_error : float
        Log odds of the first interval between equal methods.
    random_sd : mapping
        Deviation of one method's log odds between participants, and between scenes.
    df : int
    warnings : tuple of str
    """

    contrasts: tuple[PairedContrast, ...]
    shown_first: float
    shown_first_error: float
    random_sd: Mapping[str, float]
    df: int
    trials: int
    log_likelihood: float
    warnings: tuple[str, ...]
    deviations: tuple[Deviation, ...] = ()


def paired_model(
    decisions: pd.DataFrame, methods: Sequence[str], *, level: float | None = None
) -> PairedModel:
    """Fit one mixed model to all decisions between `methods`.

    Parameters
    ----------
    decisions : DataFrame, one row per decision
        Columns ``participant``, ``scene``, ``first``, ``second``, ``chosen``.
    level : float, optional
        Coverage of profile limits of the deviations; left out, there are none.

    Raises
    ------
    ValueError
        If there are fewer than two participants, or comparisons do not link all methods.

    Notes
    -----
    The log odds of the first interval are order + q_i - q_j, where a method's q is its mean plus
    a participant's deviation plus a scene's (Bradley and Terry 1952, with random slopes of
    method): two people differ in what they like and not in how often they say "first". Without
    those slopes, pairings that share a participant would look like independent evidence. The
    deviations are normal, with one sd for all methods, by Laplace's method (`glmm.fit_crossed`).
    """
    place = {name: number for number, name in enumerate(methods)}
    both = np.stack([decisions[side].map(place).to_numpy(dtype=np.int64) for side in _SIDES], 1)
    y = np.asarray(decisions["chosen"] == decisions["first"], dtype=np.float64)
    count, rows = len(methods), np.arange(len(decisions))
    won = np.zeros((count, count), dtype=np.bool_)
    won[np.where(y == 1, *both.T), np.where(y == 1, *both.T[::-1])] = True
    if len(components(won, tuple(methods))) > 1:
        raise ValueError("comparisons must link all methods for one model of all pairings")
    signs = np.zeros((len(decisions), count))
    signs[rows, both[:, 0]], signs[rows, both[:, 1]] = 1.0, -1.0
    groups, names, notes = [], [], []
    for column in ("participant", "scene"):
        codes = group_codes(decisions, column)
        if codes.max() > 0:
            groups.append(codes[:, None] * count + both)
            names.append(column)
    if "participant" not in names:
        raise ValueError("decisions must be of two participants at least")
    times = [np.broadcast_to([1.0, -1.0], both.shape)] * len(groups)
    order = np.ones((len(decisions), 1))
    fit = fit_crossed(np.hstack([order, signs[:, 1:]]), y, groups, slopes=times)
    proper = fit.converged and bool(has_maximum(won))
    if not proper:
        notes.append(
            "the model of all pairings has no finite maximum (a method, or nearly everyone, is"
            " always chosen alike): it compares nothing"
        )
    notes += [
        f"no variance of methods between levels of {name} was found (sd 0): the model is that"
        " without it"
        for name, sd in zip(names, fit.sd, strict=True)
        if sd < SINGULAR_SD
    ]
    df = len(np.unique(decisions["participant"])) - 1
    contrasts: tuple[PairedContrast, ...] = ()
    deviations: tuple[Deviation, ...] = ()
    if proper and level is not None:
        design = np.hstack([order, signs[:, 1:]])
        # A choice has two of each: no share of one answer's variance.
        deviations = crossed_deviations(fit, design, names, {}, slopes=names, level=level)
    if proper:
        compared = {tuple(sorted(pair)) for pair in np.unique(both, axis=0).tolist()}
        contrasts = _contrasts(fit, order, signs, methods, compared, df)
    return PairedModel(
        contrasts=contrasts,
        shown_first=float(fit.beta[0]) if proper else np.nan,
        shown_first_error=float(fit.beta_se[0]) if proper else np.nan,
        random_sd=dict(zip(names, map(float, fit.sd), strict=True)) if proper else {},
        df=df,
        trials=len(decisions),
        log_likelihood=fit.log_likelihood,
        warnings=tuple(notes),
        deviations=deviations,
    )


_SIDES = ("first", "second")


def _contrasts(
    fit: CrossedFit,
    order: Floats,
    signs: Floats,
    methods: Sequence[str],
    compared: set[tuple[int, ...]],
    df: int,
) -> tuple[PairedContrast, ...]:
    count = len(methods)
    quality = np.concatenate([[0.0], fit.beta[1:]])
    covariance = np.zeros((count, count))
    covariance[1:, 1:] = fit.covariance[1:count, 1:count]
    pairs = [pair for pair in combinations(range(count), 2) if pair in compared]
    # Of many methods' tastes one contrast is a small part: no deviation takes it over.
    starts = 1 if count > FEW_METHODS else None
    ratios = []
    for i, j in pairs:
        # The two methods as one: their columns added, and one left out as the zero.
        equal = np.delete(signs, j, axis=1)
        equal[:, i] += signs[:, j]
        contrast = np.eye(count)[i] - np.eye(count)[j]
        contrast[0] = 0.0  # the order's place; the first method is the zero
        reduced = np.hstack([order, equal[:, 1:]])
        ratios.append(reduced_ratio(fit, contrast, j, reduced, starts=starts)[0])
    p = two_sided_p(np.sqrt(ratios), df)
    return tuple(
        PairedContrast(
            first=methods[i],
            second=methods[j],
            estimate=float(quality[i] - quality[j]),
            standard_error=float(
                np.sqrt(max(covariance[i, i] + covariance[j, j] - 2.0 * covariance[i, j], 0.0))
            ),
            ratio=ratio,
            p=float(one),
            p_adjusted=float(adjusted),
        )
        for (i, j), ratio, one, adjusted in zip(pairs, ratios, p, holm(p), strict=True)
    )
