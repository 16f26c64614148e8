"""Marginal means of a mixed model, and contrasts of them that a study names."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.arrays import Floats
from analysis.models.contrasts import holm_where_known
from analysis.models.numeric import two_sided_p, two_sided_quantile

Asked = Mapping[str, Mapping[str, float]]
"""Contrasts by name: of each, weights of conditions."""
LARGEST_ERROR = 30.0
"""On a model's scale; the data do not identify what has a larger one."""


@dataclass(frozen=True)
class Margin:
    """A mean, or a contrast of means, on the model's scale; NaN where it is not identified.

    `p` tests 0, and `p_adjusted` is Holm's over all contrasts; of means both are NaN.
    """

    name: str
    value: float
    standard_error: float
    lower: float
    upper: float
    level: float
    df: float
    p: float = math.nan
    p_adjusted: float = math.nan

    @property
    def t(self) -> float:
        """Value in standard errors."""
        return self.value / max(self.standard_error, 1e-12)


@dataclass(frozen=True)
class Margins:
    """Means by condition, and the contrasts that were asked for."""

    means: tuple[Margin, ...]
    contrasts: tuple[Margin, ...]


NO_MARGINS = Margins((), ())


def margins(
    names: Sequence[str],
    rows: Floats,
    estimate: Floats,
    covariance: Floats,
    df: Callable[[Floats, float], float],
    *,
    level: float,
    asked: Asked,
) -> Margins:
    """Return the means of conditions and contrasts of them.

    Parameters
    ----------
    rows : ndarray (conditions, coefficients)
        What the coefficients are multiplied by, for the mean of each condition.
    estimate, covariance : ndarray (coefficients,), (coefficients, coefficients)
    df : callable
        Degrees of freedom of weights (conditions,) whose sum has this variance.
    asked
        Contrasts whose weights name other conditions are left out.

    Notes
    -----
    Searle, Speed and Milliken 1980, The American Statistician 34, 216-221, as R's emmeans.
    """

    def margin(name: str, weights: Floats) -> Margin:
        row = weights @ rows
        value, variance = float(row @ estimate), float(row @ covariance @ row)
        error = math.sqrt(max(variance, 0.0))
        if not (math.isfinite(value) and error <= LARGEST_ERROR):
            nan = math.nan
            return Margin(name, nan, nan, nan, nan, level, nan)
        free = df(weights, variance)
        reach = float(two_sided_quantile(level, free)) * error
        p = float(two_sided_p(value / max(error, 1e-12), free))
        return Margin(name, value, error, value - reach, value + reach, level, free, p)

    means = [margin(name, unit) for name, unit in zip(names, np.eye(len(names)), strict=True)]
    found = []
    for name, weights in asked.items():
        if set(weights) <= set(names):
            own = np.array([weights.get(one, 0.0) for one in names])
            # Thirds that were written in three digits sum to 0, too.
            own[own != 0.0] -= own.sum() / np.count_nonzero(own)
            found.append(margin(name, own))
    adjusted = holm_where_known([one.p for one in found])
    return Margins(
        tuple(replace(one, p=math.nan) for one in means),
        tuple(replace(one, p_adjusted=p) for one, p in zip(found, adjusted, strict=True)),
    )
