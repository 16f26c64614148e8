"""Pairs of many conditions: compare next what is expected to tell most about their scores.

After ASAP (Mikhailiuk, Wilmot, Perez-Ortiz, Yue and Mantiuk 2020, "Active sampling for pairwise
comparisons via approximate message passing and information gain maximization", ICPR). As there:

- **Model.** Thurstone's Case V. Scores q are in JOD: one JOD of difference means 75 % of the
  answers, as in `analysis.models.paired.paired_counts`. So i is chosen over j with probability
  Phi((q_i - q_j) / 1.483). Beforehand each score is normal around 0.
- **Gain of a pair.** How far the posterior is expected to move, as the Kullback-Leibler divergence
  from the present one, averaged over both answers.
- **Batch.** The pairs of the minimum spanning tree of 1 / gain. Every condition is in it, and
  all of them are linked.

Two things differ, and both make it smaller:

- **Posterior.** ASAP passes messages between independent scores. Here it is Laplace's
  approximation: the maximum of the log posterior, which is concave, and the inverse of minus its
  second derivative there. It keeps the covariances.
- **Gain.** The expected divergence is the mutual information of answer and scores. It depends on
  the difference of the two scores alone, and that is normal under the approximation. One sum over
  Gauss-Hermite nodes gives it for all pairs at once (Houlsby, Huszár, Ghahramani and Lengyel 2011,
  "Bayesian active learning for classification and preference learning", arXiv:1112.5745). ASAP
  infers again for each pair and answer, and to save time skips most pairs by chance. Here none
  is skipped.

**The prior** hardly changes which pairs are chosen, but it does set the scale of the scores while
answers are few: pairs that are hard to tell say little about how far the extremes lie apart. So
take `score_posterior` for choosing pairs, and the analysis for results.

**Ties.** A spanning tree depends on the order of the pairs alone. Gains that differ by less than
about `TIE` of the largest count as equal, and chance orders them. So a first batch, where
nothing is known, is a random tree, and the last bit of a library's function decides nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.special import entr, log_ndtr, ndtr, ndtri

from protocols.adaptive.psychometric_function import Floats
from protocols.disk.hashing import Chance
from protocols.errors import StudyError

JOD_SIGMA = float(1.0 / ndtri(0.75))
"""Standard deviation that makes a difference of 1 JOD mean 75 % of the answers."""

PRIOR_SD_JOD = float(np.sqrt(0.5)) * JOD_SIGMA
"""As in ASAP: half the variance of an answer. About 1.05 JOD."""

TIE = 1e-9

_NODES, _NODE_WEIGHTS = np.polynomial.hermite_e.hermegauss(40)
_NODE_WEIGHTS = _NODE_WEIGHTS / _NODE_WEIGHTS.sum()
_HALF_LOG_TWO_PI = 0.5 * float(np.log(2.0 * np.pi))


@dataclass(frozen=True, eq=False)
class Scores:
    """Posterior of the scores, as a normal distribution.

    Attributes
    ----------
    mean : ndarray (n,)
        JOD; they sum to 0.
    covariance : ndarray (n, n)
        JOD squared. It holds the prior's doubt about the common level, which no pair can settle;
        differences of scores are free of it.
    """

    mean: Floats
    covariance: Floats

    def difference_variance(self) -> Floats:
        """Return the variance of every difference of two scores (n, n), JOD squared."""
        variance = np.diag(self.covariance)
        spread = variance[:, None] + variance[None, :] - 2.0 * self.covariance
        return np.asarray(np.maximum(spread, 0.0))


def score_posterior(wins: ArrayLike, *, prior_sd_jod: float = PRIOR_SD_JOD) -> Scores:
    """Return Laplace's approximation to the posterior of the scores.

    Parameters
    ----------
    wins : array_like (n, n)
        ``wins[i, j]``: how often i was chosen over j.
    prior_sd_jod : float
        Standard deviation of each score beforehand.

    Raises
    ------
    StudyError
        If `wins` is no such table, or `prior_sd_jod` is not positive.
    """
    counts = _checked(wins)
    if not (np.isfinite(prior_sd_jod) and prior_sd_jod > 0):
        raise StudyError(f"prior_sd_jod: must be greater than 0 (got {prior_sd_jod:g})")
    size = len(counts)
    ridge = np.eye(size) / prior_sd_jod**2
    mean = np.zeros(size)
    # Full Newton steps: the log posterior is concave, and near enough to a parabola or a line
    # everywhere that they do not overshoot. A dozen are enough.
    for _ in range(100):
        slope, curvature = _derivatives(mean, counts)
        information = np.diag(curvature.sum(axis=1)) - curvature + ridge
        step = cho_solve(cho_factor(information), slope.sum(axis=1) - mean / prior_sd_jod**2)
        mean = mean + step
        if np.abs(step).max() < 1e-10:
            break
    _, curvature = _derivatives(mean, counts)
    information = np.diag(curvature.sum(axis=1)) - curvature + ridge
    covariance = cho_solve(cho_factor(information), np.eye(size))
    return Scores(mean - mean.mean(), np.asarray(0.5 * (covariance + covariance.T)))


def information_gain(scores: Scores) -> Floats:
    """Return the expected information of one more answer to each pair (n, n), in nats.

    Symmetric, with zeros on the diagonal.
    """
    difference = scores.mean[:, None] - scores.mean[None, :]
    variance = scores.difference_variance()
    expected = ndtr(difference / np.sqrt(JOD_SIGMA**2 + variance))
    known = np.zeros_like(expected)  # what chance adds even where both scores are known
    for node, weight in zip(_NODES, _NODE_WEIGHTS, strict=True):
        chosen = ndtr((difference + np.sqrt(variance) * node) / JOD_SIGMA)
        known += weight * (entr(chosen) + entr(1.0 - chosen))
    gain = np.maximum(entr(expected) + entr(1.0 - expected) - known, 0.0)
    gain = 0.5 * (gain + gain.T)
    np.fill_diagonal(gain, 0.0)
    return np.asarray(gain)


def next_batch(wins: ArrayLike, chance: Chance) -> tuple[tuple[int, int], ...]:
    """Return the n - 1 pairs to compare next, the most informative first.

    Parameters
    ----------
    wins : array_like (n, n)
        ``wins[i, j]``: how often i was chosen over j so far.
    chance : Chance
        Orders pairs that are equally informative. It advances, so hand in a fresh one per batch.

    Returns
    -------
    tuple of (i, j) with i < j
        A spanning tree of the conditions. Who comes first in a trial is not settled here.

    Raises
    ------
    StudyError
        If `wins` is no such table.
    """
    gain = information_gain(score_posterior(wins))
    first, second = np.triu_indices(len(gain), k=1)
    worth = gain[first, second]
    rounded = np.rint(worth / (TIE * max(float(worth.max()), 1e-300)))
    luck = np.asarray(chance.shuffled(range(len(worth))))
    order = np.lexsort((luck, -rounded))
    # Only the order counts for a minimum spanning tree; weights are ranks, since 0 means no edge.
    weight = np.zeros_like(gain)
    weight[first[order], second[order]] = np.arange(1.0, len(order) + 1.0)
    tree = minimum_spanning_tree(weight).tocoo()
    edges = sorted(zip(tree.data.tolist(), tree.row.tolist(), tree.col.tolist(), strict=True))
    return tuple((int(min(i, j)), int(max(i, j))) for _, i, j in edges)


def _derivatives(mean: Floats, wins: Floats) -> tuple[Floats, Floats]:
    """Return slope and minus the curvature of the log likelihood in each difference (n, n)."""
    scaled = (mean[:, None] - mean[None, :]) / JOD_SIGMA
    ratio = np.exp(-0.5 * scaled * scaled - _HALF_LOG_TWO_PI - log_ndtr(scaled))
    up = wins * ratio
    bend = up * (ratio + scaled)
    return (up - up.T) / JOD_SIGMA, (bend + bend.T) / JOD_SIGMA**2


def _checked(wins: ArrayLike) -> NDArray[np.float64]:
    counts = np.asarray(wins, dtype=np.float64)
    if counts.ndim != 2 or counts.shape[0] != counts.shape[1] or len(counts) < 2:
        raise StudyError(
            "wins: must be a square table with two conditions or more"
            f" (got {' x '.join(map(str, counts.shape)) or 'a number'})"
        )
    wrong = np.argwhere(~np.isfinite(counts) | (counts < 0))
    if len(wrong):
        row, column = wrong[0]
        raise StudyError(
            f"wins[{row}, {column}]: must be a count of at least 0 (got {counts[row, column]:g})"
        )
    own = np.flatnonzero(np.diag(counts))
    if len(own):
        raise StudyError(
            f"wins[{own[0]}, {own[0]}]: must be 0, since no condition is compared with itself"
            f" (got {counts[own[0], own[0]]:g})"
        )
    return counts
