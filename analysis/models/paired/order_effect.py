"""Effect of the place in a pair on its comparison, as one more number beside the scores."""

from dataclasses import dataclass

import numpy as np

from analysis.arrays import Bools, Floats
from analysis.models.bootstrap import difference_limits, draws
from analysis.models.paired.paired_counts import (
    difference_design,
    has_maximum,
    pair_index,
    solve_pairs,
)

LEAST_DRAWN = 100


@dataclass(frozen=True)
class OrderEffect:
    """Advantage of the first of a pair over the second, whatever they are, in JOD.

    Attributes
    ----------
    value, lower, upper, p : float
        With limits of the two-way bootstrap, which leave out 0 exactly where p < 1 - level.
    scores : tuple of float
        Of the conditions beside it, mean zero.
    """

    value: float
    standard_error: float
    lower: float
    upper: float
    level: float
    p: float
    scores: tuple[float, ...]


def order_effect(
    wins: Floats, *, rng: np.random.Generator, samples: int, level: float
) -> OrderEffect:
    """Fit Thurstone's Case V with a place: first minus second = score - score + order.

    Parameters
    ----------
    wins : ndarray (participants, scenes, 2, k, k)
        Votes for i over j where i came first, and where it came second.

    Raises
    ------
    ValueError
        If there are fewer than two participants, all pairs were shown in one order, or the
        likelihood has no finite maximum.

    Notes
    -----
    Davidson and Beaver 1977, Biometrics 33, 693-702 (an additive order effect), with the normal
    law. Limits: `bootstrap.difference_limits`.
    """
    people, scenes, _, count, _ = wins.shape
    first, second = pair_index(count)
    # Rows: i came first, then j came first; in both i's votes are counted as won.
    won = np.concatenate([wins[:, :, 0, first, second], wins[:, :, 1, first, second]], axis=-1)
    lost = np.concatenate([wins[:, :, 1, second, first], wins[:, :, 0, second, first]], axis=-1)
    plain = difference_design(count)
    place = np.repeat([1.0, -1.0], first.size)
    design = np.column_stack([np.tile(plain, (2, 1)), place])
    shown = (won + lost).sum(axis=(0, 1)).reshape(2, -1)
    if people < 2 or not (shown > 0).all(axis=0).any():
        raise ValueError("pairs must be shown in both orders to two participants at least")
    total = wins.sum(axis=(0, 1, 2))
    if not bool(has_maximum(total > 0)):
        raise ValueError("a method was always, or never, chosen")
    weight = [draws(size, samples, rng).astype(np.float64) for size in (people, scenes)]
    drawn_won, drawn_lost = (
        np.asarray(np.einsum("bp,bs,psv->bv", *weight, votes), dtype=np.float64)
        for votes in (won, lost)
    )
    whole = solve_pairs(design, won.sum(axis=(0, 1)), lost.sum(axis=(0, 1)))
    if not bool(whole.converged):
        raise ValueError("the place in the pair decided all answers")
    linked = _bounded(drawn_won, drawn_lost, count)
    drawn = solve_pairs(design, drawn_won[linked], drawn_lost[linked], tolerance=1e-6)
    values = drawn.parameters[drawn.converged, -1]
    if values.size < LEAST_DRAWN:
        raise ValueError("too few bootstrap samples have a finite maximum")
    lower, upper, p = difference_limits(values[:, None], people, level)
    scores = np.concatenate([[0.0], whole.parameters[:-1]])
    return OrderEffect(
        value=float(whole.parameters[-1]),
        standard_error=float(values.std(ddof=1)),
        lower=float(lower[0]),
        upper=float(upper[0]),
        level=level,
        p=float(p[0]),
        scores=tuple(map(float, scores - scores.mean())),
    )


def _bounded(won: Floats, lost: Floats, count: int) -> Bools:
    """Return True for draws (samples, 2 x pairs) with finite scores and a finite order effect."""
    first, second = pair_index(count)
    beaten = np.zeros((len(won), count, count), dtype=np.bool_)
    ways = won.reshape(len(won), 2, -1), lost.reshape(len(won), 2, -1)
    beaten[:, first, second] = (ways[0] > 0).any(axis=1)
    beaten[:, second, first] = (ways[1] > 0).any(axis=1)
    by_first = (ways[0][:, 0] + ways[1][:, 1]).sum(axis=1)
    by_second = (ways[1][:, 0] + ways[0][:, 1]).sum(axis=1)
    return np.asarray(has_maximum(beaten) & (by_first > 0) & (by_second > 0))
