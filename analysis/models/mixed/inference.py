"""Limits and tests of mixed models: the settings of all of them."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from analysis.models.numeric import ROUNDING


@dataclass(frozen=True)
class Draws:
    """Number of studies to draw from the model without what is tested, and the generator to use.

    So a likelihood ratio has p by parametric bootstrap: where people are few, its law is not known.
    """

    count: int
    rng: np.random.Generator

    def p(self, observed: float, ratio: Callable[[np.random.Generator], float]) -> float:
        """Return p of an observed ratio.

        Parameters
        ----------
        ratio : callable
            The ratio of a study that is drawn; NaN, where it has none, counts as larger.

        Notes
        -----
        Davison and Hinkley 1997, Bootstrap Methods and their Application, section 4.2.3: (1 + those
        at least as large) / (1 + draws).
        """
        if math.isnan(observed):
            return math.nan
        drawn = [ratio(self.rng) for _ in range(self.count)]
        larger = sum(not one < observed - ROUNDING for one in drawn)
        return (1.0 + larger) / (1.0 + self.count)


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
