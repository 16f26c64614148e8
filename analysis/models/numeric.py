"""Tails of distributions, numbers that rounding must not move, and numerical derivatives.

Quantiles and p are those of `scipy.stats`, which takes most of a second to import; `scipy.special`,
which it has them from, takes little.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import (
    bdtr,
    betaincinv,
    chdtrc,
    gammaincinv,
    gammaln,
    stdtr,
    stdtrit,
    xlog1py,
    xlogy,
)

from analysis.arrays import Floats


def two_sided_quantile(level: float, df: ArrayLike = np.inf) -> Floats:
    """Return the standard errors from a value to limits of coverage `level`; by t, or normal."""
    return np.asarray(stdtrit(df, 0.5 + 0.5 * level))


def two_sided_p(ratio: ArrayLike, df: ArrayLike = np.inf) -> Floats:
    """Return the two-sided p of a value over its standard error, by t, or normal."""
    return np.asarray(2.0 * stdtr(df, -np.abs(ratio)))


def chi_squared_quantile(level: float) -> float:
    """Return the value below which so large a share of chi-squared, df 1, lies."""
    return float(2.0 * gammaincinv(0.5, level))


def chi_squared_p(statistic: ArrayLike, df: float = 1.0) -> Floats:
    """Return the chance of a statistic of chi-squared that is as large or larger."""
    return np.asarray(chdtrc(df, statistic))


def binomial_below(count: ArrayLike, trials: ArrayLike, chance: float) -> Floats:
    """Return the chance of so many successes of independent trials, or fewer."""
    return np.asarray(bdtr(count, np.asarray(trials, dtype=np.int64), chance))


def binomial_log_chance(count: ArrayLike, trials: ArrayLike, chance: ArrayLike) -> Floats:
    """Return the logarithm of the chance of exactly so many successes of independent trials."""
    k, n = np.asarray(count, dtype=np.float64), np.asarray(trials, dtype=np.float64)
    ways = gammaln(n + 1.0) - gammaln(k + 1.0) - gammaln(n - k + 1.0)
    return np.asarray(ways + xlogy(k, chance) + xlog1py(n - k, -np.asarray(chance)))


def exact_binomial(
    count: int, trials: int, chance: float = 0.5, level: float = 0.95
) -> tuple[float, float, float]:
    """Return the exact two-sided p of a share of independent trials, and its limits.

    p is the chance of all numbers that are no likelier (rounding apart); limits are those of
    Clopper and Pearson.
    """
    each = np.exp(binomial_log_chance(np.arange(trials + 1), trials, chance))
    p = min(1.0, float(each[each <= each[count] * (1.0 + 1e-7)].sum()))
    tail = 0.5 - 0.5 * level
    low = betaincinv(count, trials - count + 1, tail) if count else 0.0
    high = betaincinv(count + 1, trials - count, 1.0 - tail) if count < trials else 1.0
    return p, float(low), float(high)


ROUNDING = 1e-9
"""Numbers of order 1 that differ by less are the same: processors round otherwise."""

STEP = 1e-4
"""Step of differences, relative to a value above 1."""


def zeroed(values: Floats, scale: float = 1.0) -> Floats:
    """Return values of the order of `scale`; those that only rounding keeps from 0 are 0."""
    return np.where(np.abs(values) <= ROUNDING * scale, 0.0, values)


def tied(values: Floats) -> Floats:
    """Return values of order 1 (n,); those that only rounding tells apart are one."""
    order = np.argsort(values, kind="stable")
    ranked = values[order]
    new = np.diff(ranked, prepend=-np.inf) > ROUNDING
    same = np.empty_like(ranked)
    same[order] = ranked[new][np.cumsum(new) - 1]
    return same


def slope_hessian(function: Callable[[Floats], tuple[float, Floats]], point: Floats) -> Floats:
    """Return second derivatives of a function that gives its slope too, by central differences."""
    steps = np.diag(STEP * np.maximum(1.0, np.abs(point)))
    rows = [(function(point + s)[1] - function(point - s)[1]) / (2.0 * s.sum()) for s in steps]
    return np.asarray(0.5 * (np.array(rows) + np.array(rows).T))


def delta_method(
    function: Callable[[Floats], Floats], point: Floats, covariance: Floats
) -> tuple[Floats, Floats]:
    """Return numbers (numbers,) made of parameters, and their covariance by the delta method."""
    steps = np.diag(STEP * np.maximum(1.0, np.abs(point)))
    gradient = np.array(
        [(function(point + s) - function(point - s)) / (2.0 * s.sum()) for s in steps]
    )
    return function(point), np.asarray(gradient.T @ covariance @ gradient)


def newton_polish(
    function: Callable[[Floats], tuple[float, Floats]], point: Floats
) -> tuple[Floats, Floats]:
    """Finish a quasi-Newton minimisation with Newton steps; return the point and the Hessian."""
    value, slope = function(point)
    # One-sided differences are near enough for steps; the second derivative returned is central.
    steps = np.diag(STEP * np.maximum(1.0, np.abs(point)))
    rough = np.array([(function(point + s)[1] - slope) / s.sum() for s in steps])
    inverse = np.linalg.pinv(0.5 * (rough + rough.T), hermitian=True)
    for _ in range(3):
        candidate = point - inverse @ slope
        if not np.all(np.isfinite(candidate)):
            break
        lower, next_slope = function(candidate)
        if not lower < value:
            break
        point, value, slope = candidate, lower, next_slope
    return point, slope_hessian(function, point)
