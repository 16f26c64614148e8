"""Logistic regression: maximum likelihood, Firth's penalty, robust covariances. Arrays only."""

from dataclasses import dataclass

import numpy as np
import scipy
from scipy.special import expit, log_expit

from analysis.arrays import Floats, Ints
from analysis.models.numeric import chi_squared_p, chi_squared_quantile

MAX_STEPS = 200
FARTHEST = 1e6
"""From an estimate, in logits: no limit lies farther that arithmetic could find."""


@dataclass(frozen=True)
class LogitSolution:
    """Coefficients at the maximum of the (penalised) binomial likelihood.

    `log_likelihood` has no binomial coefficients; `penalised` adds Firth's half log
    determinant where it was asked for.
    """

    beta: Floats
    covariance: Floats
    log_likelihood: float
    penalised: float
    converged: bool


def information(design: Floats, beta: Floats, trials: Floats) -> Floats:
    """Return X' W X: the expected information of `beta` in a binomial logit model.

    Its inverse gives the standard errors a design will have, before any data.
    """
    share = expit(design @ beta)
    weight = trials * share * (1.0 - share)
    return np.asarray((design.T * weight) @ design)


def fit_logit(
    design: Floats,
    successes: Floats,
    trials: Floats,
    *,
    firth: bool = False,
    fixed: int | None = None,
    at: float = 0.0,
) -> LogitSolution:
    """Maximise a binomial logit likelihood by damped Newton steps.

    Parameters
    ----------
    design : ndarray (rows, coefficients)
    successes, trials : ndarray (rows,)
    firth : bool
        Add Jeffreys' prior as a penalty (Firth 1993): finite under separation.
    fixed : int, optional
        Hold this coefficient at the value `at` (its column still enters the penalty), for
        likelihood ratios.
    """
    free = np.ones(design.shape[1], dtype=bool)
    if fixed is not None:
        free[fixed] = False
    beta = np.where(free, 0.0, at)

    def objective(candidate: Floats) -> tuple[float, float]:
        eta = design @ candidate
        value = float(successes @ log_expit(eta) + (trials - successes) @ log_expit(-eta))
        if not firth:
            return value, value
        _, log_det = np.linalg.slogdet(information(design, candidate, trials))
        return value, value + 0.5 * float(log_det)

    likelihood, penalised = objective(beta)
    converged = False
    for _ in range(MAX_STEPS):
        share = expit(design @ beta)
        info = information(design, beta, trials)
        adjusted = successes - trials * share
        if firth:
            weight = trials * share * (1.0 - share)
            hat = weight * np.einsum("ij,jk,ik->i", design, np.linalg.pinv(info), design)
            adjusted = adjusted + hat * (0.5 - share)
        slope = design.T @ adjusted
        step = np.zeros_like(beta)
        step[free] = np.linalg.lstsq(info[np.ix_(free, free)], slope[free], rcond=None)[0]
        step *= min(1.0, 5.0 / max(float(np.abs(step).max(initial=0.0)), 1e-300))
        for _halving in range(30):
            new_likelihood, new_penalised = objective(beta + step)
            if new_penalised >= penalised - 1e-12 * abs(penalised):
                break
            step *= 0.5
        beta = beta + step
        likelihood, penalised = new_likelihood, new_penalised
        if float(np.abs(step).max(initial=0.0)) < 1e-10:
            converged = True
            break
    covariance = np.asarray(
        np.linalg.pinv(information(design, beta, trials), hermitian=True), dtype=np.float64
    )
    return LogitSolution(beta, covariance, likelihood, penalised, converged)


def separated(design: Floats, successes: Floats, trials: Floats) -> bool:
    """Return True if some combination of columns predicts every answer (no finite maximum).

    Linear programme of Konis 2007: is there a direction along which the likelihood only rises?
    """
    rows = np.concatenate([design[successes > 0], -design[successes < trials]])
    rows = np.unique(np.round(rows, 12), axis=0)
    result = scipy.optimize.linprog(
        -rows.sum(axis=0),
        A_ub=-rows,
        b_ub=np.zeros(rows.shape[0]),
        bounds=[(-1.0, 1.0)] * design.shape[1],
        method="highs",
    )
    return bool(-result.fun > 1e-6) if result.status == 0 else True


def cluster_covariance(
    design: Floats,
    successes: Floats,
    trials: Floats,
    beta: Floats,
    clusters: tuple[Ints, ...],
) -> Floats:
    """Return the sandwich covariance, one-way or two-way (CR1: times G / (G - 1)).

    Cameron, Gelbach and Miller 2011. A two-way matrix that is not positive is mended by
    setting negative eigenvalues to zero, and no variance falls below the first way's.
    """
    bread = np.linalg.pinv(information(design, beta, trials), hermitian=True)
    score = design * (successes - trials * expit(design @ beta))[:, None]

    def meat(labels: Ints) -> Floats:
        _, index = np.unique(labels, return_inverse=True)
        groups = int(index.max()) + 1
        summed = np.zeros((groups, design.shape[1]))
        np.add.at(summed, index, score)
        return np.asarray(summed.T @ summed * groups / max(groups - 1, 1))

    if len(clusters) == 1:
        return np.asarray(bread @ meat(clusters[0]) @ bread)
    first, second = clusters
    both = np.unique(np.stack([first, second]), axis=1, return_inverse=True)[1]
    total = bread @ (meat(first) + meat(second) - meat(both.ravel())) @ bread
    values, vectors = np.linalg.eigh(0.5 * (total + total.T))
    mended = (vectors * values.clip(min=0.0)) @ vectors.T
    floor = np.diag(bread @ meat(first) @ bread)
    missing = np.maximum(floor - np.diag(mended), 0.0)
    return np.asarray(mended + np.diag(missing))


def likelihood_ratio_p(design: Floats, successes: Floats, trials: Floats, *, firth: bool) -> Floats:
    """Return the p-value of each coefficient by (penalised) likelihood ratio."""
    full = fit_logit(design, successes, trials, firth=firth).penalised
    values = [
        2.0 * (full - fit_logit(design, successes, trials, firth=firth, fixed=column).penalised)
        for column in range(design.shape[1])
    ]
    return chi_squared_p(np.maximum(values, 0.0))


def firth_limits(design: Floats, successes: Floats, trials: Floats, level: float) -> Floats:
    """Return limits (coefficients, 2) of Firth's penalised profile likelihood.

    They leave out 0 exactly where `likelihood_ratio_p` with ``firth=True`` is below 1 - level
    (Heinze and Schemper 2002).
    """
    full = fit_logit(design, successes, trials, firth=True)
    drop = 0.5 * chi_squared_quantile(level)
    errors = np.sqrt(np.diag(full.covariance))

    def limit(column: int, sign: float) -> float:
        def above(distance: float) -> float:
            value = float(full.beta[column]) + sign * distance
            held = fit_logit(design, successes, trials, firth=True, fixed=column, at=value)
            return held.penalised - full.penalised + drop

        far = 2.0 * float(errors[column])
        while above(far) > 0.0 and far < FARTHEST:
            far *= 2.0
        # A penalised likelihood falls without end, if slowly where answers are separated.
        distance = scipy.optimize.brentq(above, 0.0, far, xtol=1e-8) if far < FARTHEST else FARTHEST
        return float(full.beta[column] + sign * distance)

    return np.array([[limit(k, -1.0), limit(k, 1.0)] for k in range(design.shape[1])])
