"""Do the answers fit on one axis? Circular triads, agreement, stochastic transitivity."""

from dataclasses import dataclass
from functools import cache
from itertools import combinations, permutations
from math import comb

import numpy as np

from analysis.arrays import Floats
from analysis.models.numeric import chi_squared_p

ENUMERATED_CONDITIONS = 7


@dataclass(frozen=True)
class Triads:
    """Circular triads of one observer and Kendall's coefficient of consistence zeta.

    `p` is the chance that random answers give as few circular triads or fewer. `zeta` is 1 for
    an observer without contradictions, 0 for the most contradictory answers possible.
    """

    circular: float
    largest: int
    zeta: float
    p: float


@dataclass(frozen=True)
class Agreement:
    """Kendall's coefficient of agreement u between observers, with its chi-square test."""

    u: float
    smallest: float
    statistic: float
    df: float
    p: float


@dataclass(frozen=True)
class Transitivity:
    """Violations among the triples whose first two preferences chain (a over b, b over c).

    weak: a is not preferred to c; moderate: less than the weaker link; strong: less than the
    stronger one.
    """

    triples: int
    weak: int
    moderate: int
    strong: int


def circular_triads(wins: Floats) -> Triads:
    """Count contradictions (a over b over c over a) in one observer's complete comparisons.

    Parameters
    ----------
    wins : ndarray (k, k)
        1 where the row was preferred; every pair once. Repeats are reduced to the majority by
        `majority`; a tie counts half.

    Raises
    ------
    ValueError
        If there are fewer than three conditions, or a pair does not occur exactly once.

    Notes
    -----
    Kendall and Babington Smith 1940. p exactly for up to 7 conditions, chi-square above.
    """
    count = wins.shape[0]
    if count < 3:
        raise ValueError(f"wins must compare at least three conditions (got {count})")
    upper = np.triu_indices(count, 1)
    if not np.allclose((wins + wins.T)[upper], 1.0):
        raise ValueError("wins must hold every pair exactly once (use majority for repeats)")
    scores = wins.sum(axis=1)
    circular = count * (count - 1) * (2 * count - 1) / 12.0 - 0.5 * float(scores @ scores)
    largest = (count**3 - 4 * count) // 24 if count % 2 == 0 else (count**3 - count) // 24
    if count <= ENUMERATED_CONDITIONS:
        frequency = _triad_distribution(count)
        p = float(sum(n for t, n in frequency.items() if t <= circular + 1e-9)) / 2 ** comb(
            count, 2
        )
    else:
        df = count * (count - 1) * (count - 2) / (count - 4) ** 2
        statistic = 8.0 / (count - 4) * (0.25 * comb(count, 3) - circular + 0.5) + df
        p = float(chi_squared_p(statistic, df))
    return Triads(circular, largest, 1.0 - circular / largest, p)


def majority(wins: Floats) -> Floats:
    """Reduce repeated comparisons to one answer a pair: the more frequent, ½ where even."""
    return np.where(wins > wins.T, 1.0, np.where(wins < wins.T, 0.0, 0.5)) * (
        1.0 - np.eye(wins.shape[0])
    )


def agreement(wins: Floats) -> Agreement:
    """Return Kendall's u: do observers prefer the same conditions?

    Parameters
    ----------
    wins : ndarray (k, k)
        How many of the m observers preferred row to column; every observer once a pair.

    Raises
    ------
    ValueError
        If there are fewer than three observers, or one did not answer every pair once.

    Notes
    -----
    Kendall and Babington Smith 1940; chi-square with the continuity-corrected sum.
    """
    count = wins.shape[0]
    totals = (wins + wins.T)[np.triu_indices(count, 1)]
    observers = float(totals[0])
    if not np.allclose(totals, observers) or observers < 3:
        raise ValueError(
            "wins must hold every pair once from each of at least three observers"
            f" (got {totals.min():g} to {totals.max():g} answers per pair)"
        )
    pairs = comb(count, 2)
    off = wins * (1.0 - np.eye(count))
    together = float(np.sum(off * (off - 1.0)) / 2.0)
    possible = pairs * observers * (observers - 1.0) / 2.0
    u = 2.0 * together / possible - 1.0
    df = pairs * observers * (observers - 1.0) / (observers - 2.0) ** 2
    centre = 0.5 * possible * (observers - 3.0) / (observers - 2.0)
    statistic = 4.0 / (observers - 2.0) * (together - centre - 1.0)
    smallest = -1.0 / (observers - 1.0) if observers % 2 == 0 else -1.0 / observers
    return Agreement(u, smallest, statistic, df, float(chi_squared_p(statistic, df)))


def transitivity(wins: Floats) -> Transitivity:
    """Count violations of weak, moderate and strong stochastic transitivity.

    `wins` (k, k) holds how often the row was preferred to the column; triples with a pair that
    nobody compared are left out.
    """
    total = wins + wins.T
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(total > 0, wins / total, np.nan)
    triples = weak = moderate = strong = 0
    for trio in combinations(range(wins.shape[0]), 3):
        if np.isnan([share[i, j] for i, j in combinations(trio, 2)]).any():
            continue
        triples += 1
        # A triple violates if every way of reading it as a chain does not hold.
        chains = [
            (share[a, b], share[b, c], share[a, c])
            for a, b, c in permutations(trio)
            if share[a, b] >= 0.5 and share[b, c] >= 0.5
        ]
        weak += not any(direct >= 0.5 for _, _, direct in chains)
        moderate += not any(direct >= min(x, y) for x, y, direct in chains)
        strong += not any(direct >= max(x, y) for x, y, direct in chains)
    return Transitivity(triples, weak, moderate, strong)


@cache
def _triad_distribution(count: int) -> dict[int, int]:
    """Number of complete answer patterns per number of circular triads, by adding conditions."""
    # Scores of the conditions so far, order forgotten: how many patterns lead to them.
    states: dict[tuple[int, ...], int] = {(0,): 1}
    for size in range(1, count):
        grown: dict[tuple[int, ...], int] = {}
        for scores, ways in states.items():
            for code in range(2**size):
                lost = [code >> bit & 1 for bit in range(size)]
                new = tuple(
                    sorted(
                        [s + bit for s, bit in zip(scores, lost, strict=True)] + [size - sum(lost)]
                    )
                )
                grown[new] = grown.get(new, 0) + ways
        states = grown
    result: dict[int, int] = {}
    for scores, ways in states.items():
        squares = sum(score * score for score in scores)
        circular = (count * (count - 1) * (2 * count - 1) // 6 - squares) // 2
        result[circular] = result.get(circular, 0) + ways
    return result
