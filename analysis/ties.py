"""Scales with a tie threshold, where "no difference" was an answer."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize
from scipy.special import expit, ndtr

from analysis.numeric import numeric_hessian
from analysis.pairs import (
    JOD_SIGMA,
    Floats,
    Model,
    difference_design,
    has_maximum,
    log_probability,
    pair_index,
)
from analysis.scaling import centred, checked_votes


@dataclass(frozen=True)
class TiedScale:
    """Scores and tie threshold where "no difference" was an answer.

    An answer is a tie when the perceived difference stays within ± `threshold`.
    """

    model: Model
    conditions: tuple[str, ...]
    scores: Floats
    threshold: float
    covariance: Floats
    threshold_se: float
    log_likelihood: float


def scale_with_ties(
    wins: Floats, ties: Floats, conditions: Sequence[str], model: Model = "thurstone"
) -> TiedScale:
    """Fit scores and a tie threshold where observers could answer "no difference".

    Parameters
    ----------
    wins : ndarray (k, k)
        Votes for i over j.
    ties : ndarray (k, k), symmetric
        How often i and j were called equal (each tie appears in both halves).

    Notes
    -----
    Glenn and David 1960 (Thurstone), Rao and Kupper 1967 (Bradley-Terry). For two conditions
    this is the 2-AC model of signal detection.
    """
    votes = checked_votes(wins, conditions)
    if ties.shape != votes.shape or not np.allclose(ties, ties.T):
        raise ValueError(f"ties must be symmetric of shape {votes.shape} (got {ties.shape})")
    tied_pairs = np.triu(ties, k=1)
    if not np.all(np.isfinite(ties)) or np.any(ties < 0) or tied_pairs.sum() == 0:
        raise ValueError("ties must be finite, not negative, and not all zero")
    if not bool(has_maximum((votes > 0) | (ties > 0))):
        raise ValueError("no finite scores exist: some conditions always won and never tied")
    count = len(conditions)
    first, second = pair_index(count)
    won, lost, tied = votes[first, second], votes[second, first], ties[first, second]
    design = difference_design(count)
    sigma = 1.0 if model == "bradley-terry" else JOD_SIGMA

    def loss(theta: Floats) -> float:
        difference, threshold = design @ theta[:-1], np.exp(theta[-1])
        up = (difference - threshold) / sigma
        down = (-difference - threshold) / sigma
        cdf = expit if model == "bradley-terry" else ndtr
        middle = np.maximum(1.0 - cdf(up) - cdf(down), 1e-300)
        total = won * log_probability(difference - threshold, model)
        total += lost * log_probability(-difference - threshold, model)
        return -float(np.sum(total + tied * np.log(middle)))

    start = np.zeros(count)
    start[-1] = np.log(0.3 * sigma)
    best = optimize.minimize(loss, start, method="BFGS", options={"gtol": 1e-9})
    best = optimize.minimize(
        loss, best.x, method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-12}
    )
    hessian = numeric_hessian(loss, best.x)
    inverse = np.asarray(np.linalg.inv(hessian), dtype=np.float64)
    scores, covariance = centred(best.x[:-1], inverse[:-1, :-1])
    threshold = float(np.exp(best.x[-1]))
    return TiedScale(
        model=model,
        conditions=tuple(conditions),
        scores=scores,
        threshold=threshold,
        covariance=covariance,
        threshold_se=threshold * float(np.sqrt(inverse[-1, -1])),
        log_likelihood=-float(best.fun),
    )
