"""Logit model with crossed random intercepts, fitted by the Laplace approximation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from scipy.special import expit, log_expit

from analysis.logit import fit_logit
from analysis.numeric import newton_polish, numeric_hessian

Floats = NDArray[np.float64]

START_SD = 0.5

LARGEST_SD = 8.0
"""Logits; a fit beyond has run away."""


@dataclass(frozen=True)
class CrossedFit:
    """Fixed effects, their standard errors, and the deviation of each random intercept.

    `converged` is False where the likelihood has no proper maximum: deviations run off to
    infinity when nearly everyone always answers alike.
    """

    beta: Floats
    beta_se: Floats
    sd: Floats
    log_likelihood: float
    converged: bool


def fit_crossed(design: Floats, y: Floats, groups: Sequence[NDArray[np.int64]]) -> CrossedFit:
    """Maximise the Laplace likelihood of a logit model with crossed random intercepts.

    Parameters
    ----------
    design : ndarray (trials, coefficients)
    y : ndarray (trials,)
        0 or 1.
    groups : sequence of ndarray (trials,)
        Level of each random factor, counted from 0.

    Notes
    -----
    eta = X beta + sum_k sd_k b_k, b standard normal. For given (beta, sd) the mode of b is found
    by Newton steps; the Laplace likelihood is -h(mode) - log det H / 2, with h the joint negative
    log density and H its second derivative in b. The outer search runs over beta and sd (not
    its logarithm: at sd 0 the likelihood is even in sd, so a boundary fit keeps a proper second
    derivative). Standard errors invert the second derivative in all parameters.
    """
    rows, successes, trials, codes = _grouped(design, y, groups)
    sizes = [int(code.max()) + 1 for code in codes]
    total = sum(sizes)
    offsets = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    columns = np.stack([code + start for code, start in zip(codes, offsets, strict=True)])
    coefficients = design.shape[1]
    mode = np.zeros(total)

    def laplace(theta: Floats) -> float:
        nonlocal mode
        fixed = rows @ theta[:coefficients]
        sd = np.abs(theta[coefficients:])
        scale = np.repeat(sd, sizes)
        b, curvature = _mode(fixed, scale, columns, successes, trials, mode)
        mode = b
        eta = fixed + (scale * b)[columns].sum(axis=0)
        joint = successes @ log_expit(eta) + (trials - successes) @ log_expit(-eta)
        _, log_det = np.linalg.slogdet(curvature)
        return float(-(joint - 0.5 * b @ b) + 0.5 * log_det)

    start = np.concatenate(
        [fit_logit(rows, successes, trials).beta, np.full(len(groups), START_SD)]
    )
    best = optimize.minimize(laplace, start, method="BFGS", options={"gtol": 1e-5})
    polished = newton_polish(laplace, best.x)
    hessian = numeric_hessian(laplace, polished, step=1e-3)
    sd = np.abs(polished[coefficients:])
    proper = bool(np.all(np.isfinite(hessian))) and float(sd.max(initial=0.0)) < LARGEST_SD
    proper = proper and bool(np.linalg.eigvalsh(hessian)[0] > 1e-8)
    covariance = np.linalg.pinv(hessian, hermitian=True) if proper else np.eye(polished.size)
    return CrossedFit(
        beta=polished[:coefficients],
        beta_se=np.sqrt(np.diag(covariance)[:coefficients].clip(min=0.0)),
        sd=sd,
        log_likelihood=-laplace(polished),
        converged=proper,
    )


def _grouped(
    design: Floats, y: Floats, groups: Sequence[NDArray[np.int64]]
) -> tuple[Floats, Floats, Floats, list[NDArray[np.int64]]]:
    """Merge trials that share design row and levels: same likelihood, fewer rows."""
    key = np.column_stack([design, *(group.astype(np.float64) for group in groups)])
    unique, index = np.unique(key, axis=0, return_inverse=True)
    index = index.ravel()
    trials = np.bincount(index).astype(np.float64)
    successes = np.asarray(np.bincount(index, weights=y), dtype=np.float64)
    width = design.shape[1]
    return (
        np.asarray(unique[:, :width], dtype=np.float64),
        successes,
        trials,
        [unique[:, width + place].astype(np.int64) for place in range(len(groups))],
    )


def _mode(
    fixed: Floats,
    scale: Floats,
    columns: NDArray[np.int64],
    successes: Floats,
    trials: Floats,
    start: Floats,
) -> tuple[Floats, Floats]:
    """Return the mode of the random effects and the curvature there, by Newton steps."""
    size = scale.size
    b = start
    curvature = np.eye(size)
    for _ in range(100):
        eta = fixed + (scale * b)[columns].sum(axis=0)
        share = expit(eta)
        weight = trials * share * (1.0 - share)
        curvature = np.eye(size)
        slope = -b
        for rows in columns:
            slope = slope + scale * np.bincount(
                rows, weights=successes - trials * share, minlength=size
            )
            for others in columns:
                flat = np.bincount(rows * size + others, weights=weight, minlength=size * size)
                curvature += scale[:, None] * flat.reshape(size, size) * scale[None, :]
        step = np.linalg.solve(curvature, slope)
        # The joint density is log-concave; long steps far from the mode are cut short.
        step *= min(1.0, 3.0 / max(float(np.abs(step).max()), 1e-300))
        b = b + step
        if float(np.abs(step).max()) < 1e-9:
            break
    return b, curvature
