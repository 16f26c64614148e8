"""Quantiles and p of the normal, t and chi-squared distributions.

The numbers are those of `scipy.stats`, which takes most of a second to import; `scipy.special`,
which it has them from, takes little.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc, gammaincinv, stdtr, stdtrit

from analysis.arrays import Floats


def two_sided_quantile(level: float, df: ArrayLike = np.inf) -> Floats:
    """Return the standard errors from a value to limits of coverage `level`; by t, or normal."""
    return np.asarray(stdtrit(df, 0.5 + 0.5 * level))


def two_sided_p(ratio: ArrayLike, df: ArrayLike = np.inf) -> Floats:
    """Return the two-sided p of a value over its standard error, by t, or normal."""
    return np.asarray(2.0 * stdtr(df, -np.abs(ratio)))


def chi_squared_quantile(level: float, df: float = 1.0) -> float:
    """Return the value below which so large a share of chi-squared lies."""
    return float(2.0 * gammaincinv(0.5 * df, level))


def chi_squared_p(statistic: ArrayLike, df: float = 1.0) -> Floats:
    """Return the chance of a statistic of chi-squared that is as large or larger."""
    return np.asarray(chdtrc(df, statistic))
