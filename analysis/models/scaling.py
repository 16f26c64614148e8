"""Scales from paired comparisons: Thurstone Case V, in JOD."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.arrays import Floats
from analysis.models.numeric import chi_squared_p
from analysis.models.paired.paired_counts import (
    PSEUDO_VOTES,
    components,
    difference_design,
    has_maximum,
    pair_index,
    solve_pairs,
)


@dataclass(frozen=True)
class Scale:
    """Scores of conditions from paired comparisons.

    Attributes
    ----------
    model, unit : str
        "thurstone", in JOD (1 JOD = 75 % of the answers).
    conditions : tuple of str
    scores : ndarray (k,)
        Mean zero.
    covariance : ndarray (k, k)
        From the observed information; takes votes as independent. Prefer the bootstrap.
    log_likelihood : float
        Without binomial coefficients.
    deviance, fit_df, fit_p : float, int, float
        Likelihood ratio against one free proportion per pair: does one axis suffice?
    warnings : tuple of str
        When not to trust the scores.
    """

    model: str
    unit: str
    conditions: tuple[str, ...]
    scores: Floats
    covariance: Floats
    log_likelihood: float
    deviance: float
    fit_df: int
    fit_p: float
    warnings: tuple[str, ...]


def scale(wins: Floats, conditions: Sequence[str]) -> Scale:
    """Fit scores to a table of votes by maximum likelihood.

    Parameters
    ----------
    wins : ndarray (k, k)
        ``wins[i, j]`` votes for i over j. Ties may be entered as half a vote each way.
        The diagonal is ignored.
    conditions : sequence of str

    Raises
    ------
    ValueError
        If the table has a wrong shape, holds negative or non-finite counts, or comparisons do
        not link all conditions (the message names the separate groups).

    Notes
    -----
    Where some condition always won or always lost, the maximum is at infinity (Ford 1957); half
    a vote is then added to both sides of each compared pair, and the result says so.
    Thurstone 1927, Case V; 1 JOD as in Perez-Ortiz and Mantiuk 2017.
    """
    votes = checked_votes(wins, conditions)
    names = tuple(conditions)
    votes, warnings = _finite_votes(votes)
    count = len(names)
    first, second = pair_index(count)
    won, lost = votes[first, second], votes[second, first]
    solution = solve_pairs(difference_design(count), won, lost)
    covariance = np.asarray(np.linalg.inv(solution.information), dtype=np.float64)
    scores, covariance = _centred(solution.parameters, covariance)
    if not bool(solution.converged):
        warnings = (*warnings, "the fit did not converge: its scores are left out")
        scores = np.full_like(scores, np.nan)
    total = won + lost
    share = won / np.maximum(total, 1e-300)
    saturated = float(np.sum(_xlogy(won, share) + _xlogy(lost, 1.0 - share)))
    deviance = max(0.0, 2.0 * (saturated - float(solution.log_likelihood)))
    fit_df = int(np.count_nonzero(total)) - (count - 1)
    return Scale(
        model="thurstone",
        unit="JOD",
        conditions=names,
        scores=scores,
        covariance=covariance,
        log_likelihood=float(solution.log_likelihood),
        deviance=deviance,
        fit_df=fit_df,
        fit_p=float(chi_squared_p(deviance, fit_df)) if fit_df > 0 else 1.0,
        warnings=warnings,
    )


def checked_votes(wins: Floats, conditions: Sequence[str]) -> Floats:
    votes = np.array(wins, dtype=np.float64)
    count = len(conditions)
    if count < 2 or len(set(conditions)) != count:
        raise ValueError(f"conditions must be at least two distinct names (got {list(conditions)})")
    if votes.shape != (count, count):
        raise ValueError(f"wins must be {count}x{count}, one row per condition (got {votes.shape})")
    if not np.all(np.isfinite(votes)) or np.any(votes < 0):
        raise ValueError("wins must hold finite counts that are not negative")
    np.fill_diagonal(votes, 0.0)
    parts = components(votes > 0, tuple(conditions))
    if len(parts) > 1:
        listed = "; ".join("{" + ", ".join(part) + "}" for part in parts)
        raise ValueError(
            "comparisons must link all conditions for one scale;"
            f" found {len(parts)} separate groups: {listed}"
        )
    return votes


def _finite_votes(votes: Floats) -> tuple[Floats, tuple[str, ...]]:
    if bool(has_maximum(votes > 0)):
        return votes, ()
    return votes + PSEUDO_VOTES * ((votes + votes.T) > 0), (
        "some conditions always won or always lost, so no finite maximum exists;"
        " half a vote was added to both sides of each pair: distances are a lower bound",
    )


def _centred(parameters: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Put back the first score, shift the mean to zero."""
    count = parameters.size + 1
    free = np.concatenate([[0.0], parameters])
    whole = np.zeros((count, count))
    whole[1:, 1:] = covariance
    centre = np.eye(count) - 1.0 / count
    return centre @ free, centre @ whole @ centre.T


def _xlogy(count: Floats, share: Floats) -> Floats:
    safe = np.where(count > 0, share, 1.0)
    return np.asarray(count * np.log(safe))
