"""Limits and tests of mixed models: the settings of all of them."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from analysis.arrays import Floats
from analysis.models.numeric import ROUNDING


@dataclass(frozen=True)
class Draws:
    """Number of studies to draw from the model without what is tested, and the generator to use.

    So a likelihood ratio has p by parametric bootstrap: where people are few, its law is not known.
    """

    count: int
    rng: np.random.Generator

    def ratios(self, ratio: Callable[[np.random.Generator], float]) -> Floats:
        """Return the ratios of studies that are drawn, the largest first.

        Where a study has none (NaN) it counts as infinite.
        """
        drawn = np.array([ratio(self.rng) for _ in range(self.count)])
        return -np.sort(-np.where(np.isnan(drawn), np.inf, drawn))


def p_of_draws(observed: float, drawn: Floats) -> float:
    """Return p of a ratio beside `Draws.ratios`.

    Notes
    -----
    Davison and Hinkley 1997, Bootstrap Methods and their Application, section 4.2.3: (1 + those
    at least as large) / (1 + draws).
    """
    return float(1.0 + np.sum(drawn >= observed - ROUNDING)) / (1.0 + drawn.size)


def cut_of_draws(drawn: Floats, level: float) -> float:
    """Return the largest ratio whose p by draws is not below 1 - level; NaN if any's is not."""
    larger = math.ceil((1.0 - level) * (1.0 + drawn.size) - ROUNDING) - 2
    return float(drawn[larger]) + ROUNDING if larger >= 0 else math.nan


def least_p_of_draws(count: int) -> float:
    """Return the least p that so many draws can show."""
    return 1.0 / (1.0 + count)


@dataclass(frozen=True)
class Inference:
    """Limits and tests of a mixed model.

    Attributes
    ----------
    level : float
        Coverage of limits.
    profile : bool
        Deviations of random effects get profile limits, which take several times as long.
    draws : Draws, optional
        Likelihood ratios are judged by parametric bootstrap; left out, by the law of the model's
        other tests, t or chi-square.
    """

    level: float = 0.95
    profile: bool = False
    draws: Draws | None = None

    @property
    def profile_level(self) -> float | None:
        """Coverage of profile limits; None where there are none."""
        return self.level if self.profile else None


USUAL = Inference()
