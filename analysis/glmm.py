"""Models of trials with crossed random effects, fitted by the Laplace approximation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from analysis.logit import fit_logit
from analysis.numeric import newton_polish, numeric_hessian
from analysis.response import LOGIT, Response

Floats = NDArray[np.float64]

START_SD = 0.5

LARGEST_SD = 8.0
"""Logits; a fit beyond has run away."""


@dataclass(frozen=True)
class CrossedFit:
    """Fixed effects, their standard errors, and the deviation of each random effect.

    `covariance` is of beta, then sd, then the logits of fitted rates. `random` holds the mode of
    each factor's effects, in units of eta. `converged` is False where the likelihood has no
    proper maximum: deviations run off to infinity when nearly everyone always answers alike.
    """

    beta: Floats
    beta_se: Floats
    sd: Floats
    log_likelihood: float
    converged: bool
    covariance: Floats
    guess: float
    lapse: float
    random: tuple[Floats, ...]


def fit_crossed(
    design: Floats,
    y: Floats,
    groups: Sequence[NDArray[np.int64]],
    *,
    response: Response = LOGIT,
    slopes: Sequence[Floats | None] = (),
    start: Floats | None = None,
) -> CrossedFit:
    """Maximise the Laplace likelihood of a model of trials with crossed random effects.

    Parameters
    ----------
    design : ndarray (trials, coefficients)
    y : ndarray (trials,)
        0 or 1.
    groups : sequence of ndarray (trials,)
        Level of each random factor, counted from 0.
    response : Response
        How eta becomes the chance of a 1; a fitted lapse or guess rate is one more parameter.
    slopes : sequence of ndarray (trials,) or None
        What each factor's effect is multiplied by; None, or left out: 1, a random intercept.
    start : ndarray (coefficients,), optional
        Coefficients to begin with; left out, those of the logit model.

    Notes
    -----
    eta = X beta + sum_k sd_k z_k b_k, b standard normal. For given (beta, sd) the mode of b is
    found by Newton steps; the Laplace likelihood is -h(mode) - log det H / 2, with h the joint
    negative log density and H its second derivative in b. The outer search runs over beta and sd
    (not its logarithm: at sd 0 the likelihood is even in sd, so a boundary fit keeps a proper
    second derivative). Standard errors invert the second derivative in all parameters.
    """
    factors = len(groups)
    given = [slopes[place] if place < len(slopes) else None for place in range(factors)]
    rows, successes, trials, codes, kept = _grouped(
        design, y, groups, [values for values in given if values is not None]
    )
    left = iter(kept)
    factor = np.stack([np.ones(trials.size) if values is None else next(left) for values in given])
    sizes = [int(code.max()) + 1 for code in codes]
    total = sum(sizes)
    offsets = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    columns = np.stack([code + start for code, start in zip(codes, offsets, strict=True)])
    coefficients = design.shape[1]
    mode = np.zeros(total)

    def laplace(theta: Floats) -> float:
        nonlocal mode
        fixed = rows @ theta[:coefficients]
        sd = np.abs(theta[coefficients : coefficients + factors])
        free = theta[coefficients + factors :]
        rates = response.rates(free)
        scale = np.repeat(sd, sizes)
        b, curvature = _mode(
            fixed, scale, columns, factor, successes, trials, mode, response, rates
        )
        mode = b
        eta = fixed + (factor * (scale * b)[columns]).sum(axis=0)
        joint = response.log_likelihood(eta, successes, trials, rates)
        _, log_det = np.linalg.slogdet(curvature)
        return float(-(joint - 0.5 * b @ b) + 0.5 * log_det) - response.penalty(free)

    first = fit_logit(rows, successes, trials).beta if start is None else start
    begin = np.concatenate([first, np.full(factors, START_SD), response.start()])
    best = optimize.minimize(laplace, begin, method="BFGS", options={"gtol": 1e-5})
    polished = newton_polish(laplace, best.x)
    hessian = numeric_hessian(laplace, polished, step=1e-3)
    sd = np.abs(polished[coefficients : coefficients + factors])
    proper = bool(np.all(np.isfinite(hessian))) and float(sd.max(initial=0.0)) < LARGEST_SD
    proper = proper and bool(np.linalg.eigvalsh(hessian)[0] > 1e-8)
    covariance = np.eye(polished.size)
    if proper:
        covariance = np.asarray(np.linalg.pinv(hessian, hermitian=True), dtype=np.float64)
    likelihood = -laplace(polished)
    guess, lapse = response.rates(polished[coefficients + factors :])
    return CrossedFit(
        beta=polished[:coefficients],
        beta_se=np.sqrt(np.diag(covariance)[:coefficients].clip(min=0.0)),
        sd=sd,
        log_likelihood=likelihood,
        converged=proper,
        covariance=covariance,
        guess=guess,
        lapse=lapse,
        random=tuple(np.split(np.repeat(sd, sizes) * mode, np.cumsum(sizes)[:-1])),
    )


def _grouped(
    design: Floats, y: Floats, groups: Sequence[NDArray[np.int64]], slopes: Sequence[Floats]
) -> tuple[Floats, Floats, Floats, list[NDArray[np.int64]], list[Floats]]:
    """Merge trials that share design row, levels and slopes: same likelihood, fewer rows."""
    key = np.column_stack([design, *(group.astype(np.float64) for group in groups), *slopes])
    unique, index = np.unique(key, axis=0, return_inverse=True)
    index = index.ravel()
    trials = np.bincount(index).astype(np.float64)
    successes = np.asarray(np.bincount(index, weights=y), dtype=np.float64)
    width, end = design.shape[1], design.shape[1] + len(groups)
    return (
        np.asarray(unique[:, :width], dtype=np.float64),
        successes,
        trials,
        [unique[:, width + place].astype(np.int64) for place in range(len(groups))],
        [unique[:, end + place] for place in range(len(slopes))],
    )


def _mode(
    fixed: Floats,
    scale: Floats,
    columns: NDArray[np.int64],
    factor: Floats,
    successes: Floats,
    trials: Floats,
    start: Floats,
    response: Response,
    rates: tuple[float, float],
) -> tuple[Floats, Floats]:
    """Return the mode of the random effects and the curvature there, by Newton steps."""
    size = scale.size
    b = start
    curvature = np.eye(size)
    done = False
    for _ in range(100):
        eta = fixed + (factor * (scale * b)[columns]).sum(axis=0)
        gap, observed, expected = response.slope(eta, successes, trials, rates)
        curvature = _curvature(observed, scale, columns, factor)
        if not response.plain and np.any(observed < 0):
            # Guesses and lapses can bend the likelihood the wrong way far from the mode.
            try:
                np.linalg.cholesky(curvature)
            except np.linalg.LinAlgError:
                curvature = _curvature(expected, scale, columns, factor)
        if done:  # the curvature is the one at the mode itself
            break
        slope = -b
        for rows, times in zip(columns, factor, strict=True):
            slope = slope + scale * np.bincount(rows, weights=gap * times, minlength=size)
        step = np.linalg.solve(curvature, slope)
        # The joint density is log-concave; long steps far from the mode are cut short.
        step *= min(1.0, 3.0 / max(float(np.abs(step).max()), 1e-300))
        b = b + step
        done = float(np.abs(step).max()) < 1e-9
    return b, curvature


def _curvature(weight: Floats, scale: Floats, columns: NDArray[np.int64], factor: Floats) -> Floats:
    size = scale.size
    curvature = np.eye(size)
    for rows, times in zip(columns, factor, strict=True):
        for others, other_times in zip(columns, factor, strict=True):
            flat = np.bincount(
                rows * size + others, weights=weight * times * other_times, minlength=size * size
            )
            curvature += scale[:, None] * flat.reshape(size, size) * scale[None, :]
    return curvature
