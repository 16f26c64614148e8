"""How much people and scenes differ, from the sessions of a pilot."""

import numpy as np
import pandas as pd

from analysis.glmm import fit_crossed
from analysis.pairings import as_numbers, numbered
from analysis.power import NO_SPREAD, rough_guesses
from protocols.errors import StudyError


def pilot_deviations(decisions: pd.DataFrame) -> tuple[dict[str, float], tuple[str, ...]]:
    """Estimate what a simulation of power must know, from the decisions of a pilot.

    Parameters
    ----------
    decisions : DataFrame, one row per decision
        Columns ``participant``, ``scene``, ``size``, ``first``, ``second``, ``chosen``.

    Returns
    -------
    values : deviations on the logit of choices, by name of the assumption
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
    rows = rows[~_unanimous(rows)]
    if rows.empty:
        raise StudyError(
            "--from: deviations cannot be taken from this pilot (everyone answers alike in every"
            " comparison); give them by --set"
        )
    first, second = (rows[side].cat.codes.to_numpy(dtype=np.int64) for side in ("first", "second"))
    low, high = np.minimum(first, second), np.maximum(first, second)
    pairing = np.unique(low * (high.max() + 1) + high, return_inverse=True)[1]
    person, people = numbered(rows["participant"])
    scene, scenes = numbered(rows["scene"])
    size, sizes = numbered(rows["size"])
    if len(people) < 3:
        raise StudyError(f"--from: must hold three participants at least (found {len(people)})")
    cell = np.unique(pairing * len(sizes) + size, return_inverse=True)[1]
    y = np.asarray(rows["chosen"].cat.codes.to_numpy() == low, dtype=np.float64)
    design = (cell[:, None] == np.arange(cell.max() + 1)).astype(np.float64)
    if np.any(first == low) and np.any(first == high):
        design = np.column_stack([design, np.where(first == low, 0.5, -0.5)])
    factors = [(who, names) for who, names in ((person, people), (scene, scenes)) if len(names) > 1]
    kinds = [pairing] if len(sizes) == 1 else [pairing, cell]
    groups = [
        np.unique(who * (kind.max() + 1) + kind, return_inverse=True)[1].astype(np.int64)
        for who, _ in factors
        for kind in kinds
    ]
    fit = fit_crossed(design, y, groups)
    if not fit.converged:
        raise StudyError(NO_SPREAD)
    variance = (fit.sd**2).reshape(len(factors), len(kinds))
    total = variance.sum(axis=1)
    values = {"participant_sd": float(np.sqrt(total[0]))}
    if len(factors) > 1:
        values["scene_sd"] = float(np.sqrt(total[1]))
    if len(sizes) > 1 and total.sum() > 0:
        values["size_correlation"] = float(variance[:, 0].sum() / total.sum())
    return values, rough_guesses(len(people), len(scenes))


def _unanimous(rows: pd.DataFrame) -> "pd.Series[bool]":
    """Say of each decision whether its pairing at its size was always decided alike."""
    both = rows[["first", "second"]].astype(str)
    pair = both.min(axis=1) + "\n" + both.max(axis=1)
    chosen = rows["chosen"].astype(str).groupby([pair, rows["size"].astype(str)])
    return chosen.transform("nunique") == 1
