"""Bayes factors for a share against one half."""

import math

import numpy as np
import scipy

CAUCHY_SCALE = float(np.sqrt(0.5))
"""Scale of the default prior on the standardised effect ("medium", Rouder et al. 2009)."""


def binomial_bayes_factor(chosen: int, trials: int) -> float:
    """Return BF10 of a uniform prior on the share against .5; trials independent."""
    log_marginal = scipy.special.betaln(chosen + 1, trials - chosen + 1)
    return float(np.exp(min(log_marginal + trials * np.log(2.0), 700.0)))


def t_bayes_factor(t: float, count: float, scale: float = CAUCHY_SCALE) -> float:
    """Return BF10 of a one-sample t with a Cauchy prior on the standardised effect.

    `count` is the number of participants; a clustered t enters with its df + 1.
    Rouder, Speckman, Sun, Morey and Iverson 2009, Psychonomic Bulletin & Review 16, eq. 1.
    """
    df = count - 1

    def integrand(log_g: float) -> float:
        g = math.exp(log_g)
        inflated = 1.0 + count * g * scale**2
        log_value = -0.5 * math.log(inflated)
        log_value -= 0.5 * (df + 1) * math.log1p(t * t / (inflated * df))
        log_value += 0.5 * (df + 1) * math.log1p(t * t / df)
        # Density of g, inverse gamma (1/2, 1/2), times dg / d log g.
        log_value += -0.5 * math.log(2.0 * math.pi) - 0.5 * log_g - 0.5 / g
        return math.exp(min(log_value, 700.0))

    value, _ = scipy.integrate.quad(integrand, -25.0, 40.0, limit=400, epsabs=0.0, epsrel=1e-8)
    return float(value)
