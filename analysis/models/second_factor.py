"""Interaction of conditions with a second factor, such as size: does their difference change?"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import pandas as pd

from analysis.arrays import Floats
from analysis.models.bootstrap import difference_limits, drawn_scores, draws
from analysis.models.cells import TrialGrid
from analysis.models.clustered import holm
from analysis.models.contrasts import Difference
from analysis.models.right_answers import contrasts, event_influence
from analysis.models.scaling import scale

LEAST_DRAWS = 20


def share_interactions(
    happened: Mapping[str, Mapping[str, pd.Series]], places: TrialGrid, measure: str, level: float
) -> tuple[Difference, ...]:
    """Return the differences of a share between all pairs of values of the factor.

    Parameters
    ----------
    happened : mapping of value to (mapping of condition to Series of 0 and 1)
        Trials on the grid. With two conditions, it is the difference of their shares that differs.

    Notes
    -----
    `clustered.two_way_difference`: scenes may be seen at one value only, and participants too.
    """
    moved = {}
    for value, several in happened.items():
        each = [event_influence(event, places) for event in several.values()]
        moved[value] = each[0] if len(each) == 1 else each[0].minus(each[1])
    return contrasts(measure, moved, level=level)


def jod_interactions(
    votes: Mapping[str, Floats],
    methods: Sequence[str],
    pairings: Sequence[tuple[str, str]],
    *,
    level: float,
    samples: int,
    rng: np.random.Generator,
) -> dict[tuple[str, str], tuple[Difference, ...]]:
    """Return the differences of a distance in JOD between all pairs of values of the factor.

    Parameters
    ----------
    votes : mapping of value to ndarray (participants, scenes, k, k)
        Of `methods`, on one grid, with 0 where a scene was not shown.

    Returns
    -------
    mapping of pairing to differences, Holm-adjusted over all

    Raises
    ------
    ValueError
        If too few draws link all methods at each value.

    Notes
    -----
    Two-way bootstrap, people drawn alike for all values. So are scenes that were shown at several;
    where each was shown at one value, each value's are drawn by themselves, and limits are widened
    for as few clusters as the smallest value has.
    """
    people = next(iter(votes.values())).shape[0]
    seen = {value: one.sum(axis=(0, 2, 3)) > 0 for value, one in votes.items()}
    apart = sum(mask.astype(int) for mask in seen.values()).max() < 2
    weight, whole = draws(people, samples, rng), draws(len(next(iter(seen.values()))), samples, rng)
    drawn, true = {}, {}
    for name, one in votes.items():
        shown = one[:, seen[name]]
        places = draws(shown.shape[1], samples, rng) if apart else whole[:, seen[name]]
        drawn[name] = drawn_scores(shown, weight, places)
        true[name] = scale(one.sum(axis=(0, 1)), tuple(methods)).scores
    kept = np.all([np.isfinite(one).all(axis=1) for one in drawn.values()], axis=0)
    if kept.sum() < LEAST_DRAWS:
        raise ValueError(
            f"too few bootstrap samples link all methods at each value ({kept.sum()} of {samples})"
        )
    counts = [int(mask.sum()) for mask in seen.values() if apart and mask.sum() > 1]
    clusters = min([people, *counts])
    at = {name: number for number, name in enumerate(methods)}
    found = []
    for pairing in pairings:
        left, right = at[pairing[0]], at[pairing[1]]
        for first, second in combinations(votes, 2):
            scores = (drawn[first], drawn[second], true[first], true[second])
            gaps = [one_of[..., left] - one_of[..., right] for one_of in scores]
            gap = (gaps[0] - gaps[1])[kept]
            lower, upper, p = difference_limits(gap[:, None], clusters, level)
            changed = Difference(
                measure="JOD",
                first=first,
                second=second,
                difference=float(gaps[2] - gaps[3]),
                standard_error=float(gap.std(ddof=1)),
                lower=float(lower[0]),
                upper=float(upper[0]),
                level=level,
                df=float(clusters - 1),
                p=float(p[0]),
                p_adjusted=float(p[0]),
            )
            found.append((pairing, changed))
    adjusted = holm(np.array([one.p for _, one in found])).tolist()
    result: dict[tuple[str, str], tuple[Difference, ...]] = {}
    for (pairing, changed), together in zip(found, adjusted, strict=True):
        result[pairing] = (*result.get(pairing, ()), replace(changed, p_adjusted=together))
    return result
