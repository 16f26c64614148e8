"""Paired-comparison counts and the batched Newton solver under every scale.

Everything here works on the distinct pairs of a design: `design` (pairs, parameters) turns
parameters into the signed difference of each pair, `wins` and `losses` (…, pairs) count the
answers. Leading axes are batches, so a thousand bootstrap samples are one call.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtri

from analysis.arrays import Bools, Floats

JOD_SIGMA = float(1.0 / ndtri(0.75))
"""Standard deviation that makes a difference of 1 JOD mean 75 % of the answers."""

PSEUDO_VOTES = 0.5
"""Added to both sides of every compared pair where no finite maximum exists."""

_HALF_LOG_TWO_PI = 0.5 * np.log(2.0 * np.pi)


@dataclass(frozen=True)
class PairSolution:
    """Maximum of the likelihood of paired comparisons, one per batch entry.

    Attributes
    ----------
    parameters : ndarray (..., parameters)
    log_likelihood : ndarray (...)
        Without the binomial coefficients.
    information : ndarray (..., parameters, parameters)
        Negative second derivative at the maximum.
    converged : ndarray of bool (...)
    """

    parameters: Floats
    log_likelihood: Floats
    information: Floats
    converged: Bools


def pair_index(count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the pairs (i < j) of `count` conditions in row order."""
    return np.triu_indices(count, k=1)


def difference_design(count: int) -> Floats:
    """Return the design (pairs, count - 1) of score differences; the first score is 0."""
    first, second = pair_index(count)
    rows = np.arange(first.size)
    design = np.zeros((first.size, count))
    design[rows, first] = 1.0
    design[rows, second] = -1.0
    return design[:, 1:]


def log_probability(difference: Floats) -> Floats:
    """Return the log probability that the first of a pair is chosen."""
    return np.asarray(log_ndtr(difference / JOD_SIGMA), dtype=np.float64)


def choice_share(difference: Floats) -> Floats:
    """Return the probability that the first of a pair is chosen."""
    return np.asarray(np.exp(log_probability(np.asarray(difference))))


def solve_pairs(
    design: Floats, wins: Floats, losses: Floats, *, tolerance: float = 1e-10
) -> PairSolution:
    """Maximise Thurstone's likelihood of paired comparisons by damped Newton steps, in batches.

    It is concave, so the maximum is unique where it exists; whether it exists is the
    caller's question (`has_maximum`).

    Parameters
    ----------
    design : ndarray (pairs, parameters)
    wins, losses : ndarray (..., pairs)
        How often the first and the second of each pair were chosen. Weights may be fractions.

    Notes
    -----
    The log ratios are taken through ``log_ndtr``, so a million votes a pair end at the same
    scores as a hundred: nothing underflows.
    """
    batch = wins.shape[:-1]
    first = wins.reshape(-1, wins.shape[-1])
    second = losses.reshape(first.shape)
    size = design.shape[1]
    parameters = np.zeros((first.shape[0], size))
    outer = (design[:, :, None] * design[:, None, :]).reshape(design.shape[0], size * size)
    active = np.arange(first.shape[0])
    converged = np.zeros(first.shape[0], dtype=bool)
    for _ in range(60):
        slope, curvature = _derivatives(
            parameters[active] @ design.T, first[active], second[active]
        )
        information = (curvature @ outer).reshape(active.size, size, size)
        step = _solve(information, slope @ design)
        largest = np.abs(step).max(axis=-1, initial=0.0)
        # Far from the maximum a full step may overshoot; near it the limit is never reached.
        step *= np.minimum(1.0, 2.0 * JOD_SIGMA / np.maximum(largest, 1e-300))[:, None]
        parameters[active] += step
        done = largest < tolerance
        converged[active[done]] = True
        active = active[~done]
        if active.size == 0:
            break
    difference = parameters @ design.T
    likelihood = first * log_probability(difference)
    likelihood += second * log_probability(-difference)
    _, curvature = _derivatives(difference, first, second)
    return PairSolution(
        parameters=parameters.reshape(*batch, size),
        log_likelihood=likelihood.sum(axis=-1).reshape(batch),
        information=(curvature @ outer).reshape(*batch, size, size),
        converged=converged.reshape(batch),
    )


def fit_scores(won: Floats, lost: Floats, count: int, *, tolerance: float = 1e-6) -> Floats:
    """Fit many vote tables in JOD at once; pseudo-votes only where a table has no finite maximum.

    Parameters
    ----------
    won, lost : ndarray (..., pairs)
        Votes for the first and the second of each pair, pairs as `pair_index`.

    Returns
    -------
    ndarray (..., count)
        Mean-zero scores; NaN where comparisons do not link all conditions.
    """
    first, second = pair_index(count)
    beaten = np.zeros((*won.shape[:-1], count, count), dtype=np.bool_)
    beaten[..., first, second] = won > 0
    beaten[..., second, first] = lost > 0
    linked = has_maximum(beaten | beaten.swapaxes(-1, -2))
    infinite = linked & ~has_maximum(beaten)
    if infinite.any():
        extra = PSEUDO_VOTES * ((won + lost) > 0) * infinite[..., None]
        won, lost = won + extra, lost + extra
    scores = np.full((*won.shape[:-1], count), np.nan)
    if linked.any():
        design = difference_design(count)
        solution = solve_pairs(design, won[linked], lost[linked], tolerance=tolerance)
        free = np.concatenate(
            [np.zeros((solution.parameters.shape[0], 1)), solution.parameters], axis=1
        )
        free[~solution.converged] = np.nan
        scores[linked] = free - free.mean(axis=1, keepdims=True)
    return scores


def has_maximum(won: Bools) -> Bools:
    """Return True if a finite maximum exists: the graph "was chosen over" is strongly connected.

    Parameters
    ----------
    won : ndarray of bool (..., k, k)
        ``won[i, j]``: i was chosen over j at least once.

    Notes
    -----
    Ford 1957, "Solution of a ranking problem from binary comparisons".
    """
    count = won.shape[-1]
    reach = won | np.eye(count, dtype=bool)
    for _ in range(max(1, int(np.ceil(np.log2(max(count, 2)))))):
        reach = np.matmul(reach.astype(np.float32), reach.astype(np.float32)) > 0.0
    return np.asarray(reach.all(axis=(-1, -2)))


def components(compared: Bools, names: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Return the groups of conditions that comparisons link, by name, in order."""
    count, label = scipy.sparse.csgraph.connected_components(compared | compared.T, directed=False)
    return tuple(
        tuple(name for name, group in zip(names, label, strict=True) if group == part)
        for part in range(count)
    )


def _derivatives(difference: Floats, first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Return the slope and minus the curvature of the log likelihood in each difference."""
    scaled = difference / JOD_SIGMA
    log_density = -0.5 * scaled * scaled - _HALF_LOG_TWO_PI
    up = np.exp(log_density - log_ndtr(scaled))
    down = np.exp(log_density - log_ndtr(-scaled))
    slope = (first * up - second * down) / JOD_SIGMA
    curvature = (first * up * (up + scaled) + second * down * (down - scaled)) / JOD_SIGMA**2
    return slope, curvature


def _solve(information: Floats, slope: Floats) -> Floats:
    """Newton steps; a hair of ridge keeps a nearly flat direction solvable."""
    size = slope.shape[-1]
    trace = np.trace(information, axis1=-2, axis2=-1)
    ridge = (1e-12 * np.maximum(trace, 1e-300) / max(size, 1))[:, None, None] * np.eye(size)
    return np.asarray(np.linalg.solve(information + ridge, slope[..., None])[..., 0])
