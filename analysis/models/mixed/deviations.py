"""Standard deviations of random effects: profile limits and shares of variance."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial

from analysis.arrays import Floats
from analysis.models.mixed.profile import profile_end
from analysis.models.numeric import chi_squared_quantile

MOST_PROFILED = 300
"""Effects together, at most, that get profile limits: more take minutes."""
LATENT_VARIANCE = {"logit": math.pi**2 / 3.0, "probit": 1.0}
"""Variance of one answer on the scale of the model, by link."""


@dataclass(frozen=True)
class Deviation:
    """The standard deviation of one random effect.

    Attributes
    ----------
    lower, upper : float
        Of the profile likelihood; NaN where they were not searched, infinite without an end.
    icc : float
        Share of the variance of one answer on the model's scale (intraclass correlation); NaN of
        slopes.
    """

    name: str
    sd: float
    lower: float
    upper: float
    icc: float


def profile_limits(
    log_likelihood: Callable[[float], float], sd: float, best: float, error: float, level: float
) -> tuple[float, float]:
    """Return the places at which a profile likelihood falls by half the quantile of chi-square (1).

    Parameters
    ----------
    log_likelihood : callable
        From the deviation, at least 0, to the maximum over all else.
    sd, best : float
        Where it is largest, and how large.
    error : float
        About the standard error of `sd`: of the first step.
    """
    cut = math.sqrt(chi_squared_quantile(level))

    @cache  # a search for a root asks for both ends again
    def beyond(value: float) -> float:
        if value == sd:
            return -cut
        return math.sqrt(max(2.0 * (best - log_likelihood(value)), 0.0)) - cut

    step = error if math.isfinite(error) and error > 0.0 else max(sd, 0.1)
    lower = 0.0
    if sd > 0.0 and beyond(0.0) > 0.0:
        lower = profile_end(beyond, sd, 0.0)
    return lower, profile_end(beyond, sd, sd + 2.0 * step)


@dataclass(frozen=True)
class FittedEffects:
    """Random effects of a fitted model, of whichever kind.

    Attributes
    ----------
    sd, errors
        By name of the effect, and about the standard errors of these.
    held : callable
        From the number of an effect and its deviation, held there, to the maximum over all else;
        `best` where none is held.
    effects : int
        Number of their levels together.
    rest : float
        Variance of one answer. `slopes` name the deviations that have no share of it: where what
        they multiply is at its middle they are 0.
    """

    sd: Mapping[str, float]
    errors: Floats
    held: Callable[[int, float], float]
    best: float
    effects: int
    rest: float
    slopes: Sequence[str] = ()

    def deviations(self, level: float) -> tuple[Deviation, ...]:
        """Return deviations with profile limits, and their shares of the variance.

        Of more than `MOST_PROFILED` levels limits are not had.
        """
        total = self.rest + sum(own**2 for name, own in self.sd.items() if name not in self.slopes)
        found = []
        for number, (name, own) in enumerate(self.sd.items()):
            ends: tuple[float, float] = math.nan, math.nan
            if self.effects <= MOST_PROFILED:
                held, error = partial(self.held, number), float(self.errors[number])
                ends = profile_limits(held, own, self.best, error, level)
            icc = math.nan if name in self.slopes else own**2 / total
            found.append(Deviation(name, own, *ends, icc))
        return tuple(found)
