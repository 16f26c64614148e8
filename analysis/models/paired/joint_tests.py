"""Tests that all methods are equal, and that one axis suffices, for people and scenes."""

from dataclasses import dataclass

import numpy as np
import scipy

from analysis.arrays import Floats
from analysis.models.bootstrap import drawn_scores, draws
from analysis.models.clustered import least_p
from analysis.models.paired.paired_counts import fit_scores, pair_index, probability

LEAST_DRAWN = 100


@dataclass(frozen=True)
class JointTest:
    """A test of several numbers at once: F with its degrees of freedom."""

    f: float
    df: int
    rest_df: int
    p: float


@dataclass(frozen=True)
class JointTests:
    """`equal`: all scores are equal. `axis`: shares of pairs follow from scores; None: untested."""

    equal: JointTest | None
    axis: JointTest | None
    notes: tuple[str, ...]


def joint_tests(wins: Floats, *, rng: np.random.Generator, samples: int) -> JointTests:
    """Test scores, and what shares of pairs have beyond them, by a two-way bootstrap.

    Parameters
    ----------
    wins : ndarray (participants, scenes, k, k)
        Votes for i over j.

    Notes
    -----
    Hotelling's T² of q numbers with the bootstrap's covariance is (P - 1) q / (P - q) times F with
    q and P - q degrees of freedom, P participants. One axis: the q = pairs - (k - 1) numbers by
    which shares of pairs depart from those of the scores. No p is below that of unanimous
    participants.
    """
    people, scenes, count, _ = wins.shape
    weight = draws(people, samples, rng), draws(scenes, samples, rng)
    scores = drawn_scores(wins, *weight)
    drawn = np.einsum("bp,bs,psij->bij", *(one.astype(np.float64) for one in weight), wins)
    first, second = pair_index(count)

    def departures(votes: Floats, at: Floats) -> Floats:
        won, lost = votes[..., first, second], votes[..., second, first]
        with np.errstate(invalid="ignore"):
            share = won / (won + lost)
        expected = probability(at[..., first] - at[..., second], "thurstone")
        return np.asarray(share - expected)

    total = wins.sum(axis=(0, 1))
    shown = total[first, second] + total[second, first] > 0
    best = fit_scores(total[first, second][None], total[second, first][None], count, "thurstone")[0]
    apart = departures(drawn, scores)[:, shown]
    kept = np.isfinite(scores).all(axis=1) & np.isfinite(apart).all(axis=1)
    if kept.sum() < LEAST_DRAWN:
        return JointTests(None, None, ("too few bootstrap samples link all conditions",))
    beyond = int(shown.sum()) - (count - 1)
    tests = [
        _hotelling(value, sample, df, people)
        for value, sample, df in (
            (best[1:] - best[0], scores[kept, 1:] - scores[kept, :1], count - 1),
            (departures(total, best)[shown], apart[kept], beyond),
        )
    ]
    return JointTests(tests[0], tests[1], ())


def _hotelling(value: Floats, drawn: Floats, df: int, people: int) -> JointTest | None:
    """Test `df` dimensions of a value (n,) by the covariance of draws (samples, n)."""
    if not 0 < df < people:
        return None
    curvature, axes = np.linalg.eigh(np.atleast_2d(np.cov(drawn, rowvar=False)))
    kept = slice(curvature.size - df, None)
    if curvature[kept].min() <= 1e-12 * curvature.max():
        return None
    along = axes[:, kept].T @ value
    f = float(along**2 @ (1.0 / curvature[kept])) * (people - df) / (df * (people - 1.0))
    p = max(float(scipy.stats.f.sf(f, df, people - df)), float(least_p(people)))
    return JointTest(f, df, people - df, p)
