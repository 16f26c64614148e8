"""Order and side bias: is the first interval, or one key, chosen too often?"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from analysis.models.clustered import holm, sign_flip_p, two_way
from analysis.models.compared_methods import cell_counts
from analysis.models.numeric import binomial_below, exact_binomial
from protocols.errors import count_of


@dataclass(frozen=True)
class Bias:
    """Share of one alternative among all choices, whatever it showed.

    Attributes
    ----------
    alternative : str
        "first interval" or "left key".
    share, lower, upper, p : float
        Clustered by participant and scene, against one half.
    sign_flip_p : float
    extreme : tuple of (participant, share, p)
        Participants whose own share differs from one half (exact binomial, Holm over people).
    warnings : tuple of str
    """

    alternative: str
    trials: int
    share: float
    lower: float
    upper: float
    p: float
    sign_flip_p: float
    by_participant: tuple[tuple[str, float], ...]
    extreme: tuple[tuple[str, float, float], ...]
    warnings: tuple[str, ...]


def order_bias(decisions: pd.DataFrame, *, alpha: float = 0.05) -> Bias:
    """Return the rate of picking the first interval, against one half, with limits.

    `decisions` has ``participant``, ``scene`` and ``chose_first`` (0/1); limits cover 1 - `alpha`.
    """
    picked = decisions["chose_first"].astype(float)
    return _bias("first interval", decisions, picked, alpha)


def came_both_ways(decisions: pd.DataFrame) -> bool:
    """Return True if a pair was shown in both orders: else order and preference are one thing."""
    pairs = set(zip(decisions["first"], decisions["second"], strict=True))
    return any((second, first) in pairs for first, second in pairs)


def has_sides(decisions: pd.DataFrame) -> bool:
    """Return True if sides were recorded."""
    return bool(decisions["chosen_side"].isin(("left", "right")).any())


def side_bias(decisions: pd.DataFrame, *, alpha: float = 0.05) -> Bias | None:
    """Return the rate of pressing the left key; None where sides were not recorded.

    As `order_bias`, with ``chosen_side`` (left, right, or anything else where none was).
    """
    if not has_sides(decisions):
        return None
    known = decisions[decisions["chosen_side"].isin(("left", "right"))]
    return _bias("left key", known, (known["chosen_side"] == "left").astype(float), alpha)


def _bias(alternative: str, rows: pd.DataFrame, picked: pd.Series, alpha: float) -> Bias:
    chosen, shown, people, _ = cell_counts(rows, picked.to_numpy(dtype=np.float64))
    wins, totals = chosen.sum(axis=1), shown.sum(axis=1)
    shares = wins / totals
    # Against one half the exact two-sided test is twice the smaller tail.
    own = np.minimum(1.0, 2.0 * binomial_below(np.minimum(wins, totals - wins), totals, 0.5))
    adjusted = holm(own)
    notes = []
    flip = sign_flip_p(shares - 0.5)
    if len(people) < 2:
        share, notes = float(wins.sum() / totals.sum()), ["one participant only"]
        p, lower, upper = exact_binomial(int(wins.sum()), int(totals.sum()), level=1.0 - alpha)
    else:
        estimate = two_way(chosen, shown)
        share = float(estimate.share)
        low, high = estimate.limits(1.0 - alpha)
        lower, upper, p = float(low), float(high), float(estimate.p_value())
        if estimate.standard_error == 0:
            notes.append("every participant picked equally often")
    extreme = tuple(
        (str(name), float(share_of), float(p_of))
        for name, share_of, p_of in zip(people, shares, adjusted, strict=True)
        if p_of < alpha
    )
    if extreme:
        notes.append(
            f"{count_of(len(extreme), 'participant')} answer{'s' * (len(extreme) == 1)} by"
            f" {alternative.split()[1]} more than by content: "
            + ", ".join(name for name, _, _ in extreme)
        )
    return Bias(
        alternative=alternative,
        trials=int(totals.sum()),
        share=share,
        lower=lower,
        upper=upper,
        p=p,
        sign_flip_p=flip,
        by_participant=tuple(
            (str(name), float(value)) for name, value in zip(people, shares, strict=True)
        ),
        extreme=extreme,
        warnings=tuple(notes),
    )
