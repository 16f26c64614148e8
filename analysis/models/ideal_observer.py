"""Ideal observers of detection theory: from d' to the share of right answers, and back.

Every function takes and returns arrays. A share below chance gives a negative d': noise around
chance then averages out, instead of being folded to the positive side.
"""

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np
import scipy
from scipy.special import ndtr, ndtri

from analysis.arrays import Floats

AbxRule = Literal["differencing", "independent", "dual-pair"]
Correction = Literal["log-linear", "none"]

ROOT_2, ROOT_6 = np.sqrt(2.0), np.sqrt(6.0)

SCALES: dict[AbxRule, tuple[float, float]] = {
    "differencing": (float(ROOT_2), float(ROOT_6)),
    "independent": (float(ROOT_2), 2.0),
    "dual-pair": (2.0, 2.0),
}
"""Deviations of the two quantities of which an answer is right where both have one sign."""

LARGEST_D_PRIME = 12.0


def corrected_share(
    count: Floats | float, total: Floats | float, chance: float, correction: Correction
) -> Floats:
    """Return count / total, or with one trial at chance added (`log-linear`, Hautus 1995).

    The correction is for every condition or for none, so that conditions stay comparable.
    """
    if correction not in get_args(Correction):
        raise ValueError(f"correction must be one of {get_args(Correction)} (got {correction!r})")
    extra = 1.0 if correction == "log-linear" else 0.0
    return np.asarray(
        (np.asarray(count, dtype=np.float64) + extra * chance) / (np.asarray(total) + extra)
    )


def abx_share(d_prime: Floats | float, rule: AbxRule = "differencing") -> Floats:
    """Return the share of right answers of an unbiased observer in ABX, or of two pairs.

    Parameters
    ----------
    d_prime : ndarray or float
        Distance of A and B in standard deviations. Negative: answers are wrong as often as they
        would be right at its size.
    rule : {"differencing", "independent", "dual-pair"}
        ``differencing``: X is called A where |X - A| < |X - B|, so the observer compares
        distances of single observations:
        p = Phi(d / sqrt 2) Phi(d / sqrt 6) + Phi(-d / sqrt 2) Phi(-d / sqrt 6).
        ``independent``: the optimal rule for two fixed stimuli; X and the difference A - B are
        judged apart: p = Phi(d / sqrt 2) Phi(d / 2) + Phi(-d / sqrt 2) Phi(-d / 2).
        ``dual-pair``: not ABX; of two pairs of observations one differs, and the pair with the
        larger difference is chosen, as where one half of a picture changes and the other does
        not: p = Phi(d / 2)^2 + Phi(-d / 2)^2.

    Notes
    -----
    Macmillan and Creelman 2005, "Detection Theory", 2nd ed., chapter 9; Hautus and Meng 2002,
    Perception and Psychophysics 64(1), who found observers to take differences. Freeman and
    Simoncelli 2011 use the independent rule. Dual pair: Rousseau and Ennis 2001, Perception and
    Psychophysics 63(6); the sum and the difference of the two differences are independent, each of
    deviation 2.
    """
    size = np.abs(np.asarray(d_prime, dtype=np.float64))
    if rule not in SCALES:
        raise ValueError(f"rule must be one of {get_args(AbxRule)} (got {rule!r})")
    scales = SCALES[rule]
    first, other = ndtr(size / scales[0]), size / scales[1]
    share = first * ndtr(other) + (1.0 - first) * ndtr(-other)
    return np.asarray(0.5 + np.sign(d_prime) * (share - 0.5))


def abx_d_prime(share: Floats | float, rule: AbxRule = "differencing") -> Floats:
    """Return d' of an ABX share of right answers; negative below one half.

    Notes
    -----
    Near chance the share rises with the square of d', so its Fisher information about d' is 0
    at d' = 0, and |d'| of noisy shares follows a folded law like Rice's: always above 0. The
    analysis plan of our studies asks for a "Fisher-Rice-corrected d'". No source has that
    phrase. We read it as the correction of these two biases, and make it so: the sign of
    share - 1/2 is kept, so that noise is not folded (Rice), and one trial at chance is added
    to every condition's count (`corrected_share`), which is the penalty of Firth and Hautus
    for a share without finite estimate.
    """
    share = np.asarray(share, dtype=np.float64)
    edges = 0.5 + np.abs(share - 0.5)
    size = _inverse(lambda d: abx_share(d, rule), edges, 0.0, LARGEST_D_PRIME)
    return np.asarray(np.sign(share - 0.5) * size)


def forced_choice_share(d_prime: Floats | float, alternatives: int) -> Floats:
    """Return the share of right answers among m alternatives, each of them equally likely.

    p = integral of phi(x - d) Phi(x)^(m - 1) dx: the right alternative gives the largest of m
    independent normal values (Green and Swets 1966; Hacker and Ratcliff 1979). For m = 2 it is
    Phi(d / sqrt 2).
    """
    if alternatives < 2:
        raise ValueError(f"alternatives must be at least 2 (got {alternatives})")
    d = np.asarray(d_prime, dtype=np.float64)
    if alternatives == 2:
        return np.asarray(ndtr(d / ROOT_2))
    x, step = np.linspace(-9.0, 9.0, 721, retstep=True)
    values = scipy.stats.norm.pdf(x) * ndtr(x + d[..., None]) ** (alternatives - 1)
    return np.asarray(values.sum(axis=-1) * step)


def forced_choice_d_prime(share: Floats | float, alternatives: int) -> Floats:
    """Return d' of a share of right answers among m alternatives; negative below chance."""
    if alternatives == 2:
        return np.asarray(ROOT_2 * ndtri(np.asarray(share, dtype=np.float64)))
    return _inverse(
        lambda d: forced_choice_share(d, alternatives),
        np.asarray(share, dtype=np.float64),
        -LARGEST_D_PRIME,
        LARGEST_D_PRIME,
    )


def _inverse(
    function: Callable[[Floats], Floats], values: Floats, lower: float, upper: float
) -> Floats:
    """Invert a rising function by bisection, to 1e-12; beyond its range give infinity."""
    low, high = np.full(values.shape, lower), np.full(values.shape, upper)
    for _ in range(48):
        middle = 0.5 * (low + high)
        below = function(middle) < values
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    found = 0.5 * (low + high)
    return np.asarray(np.where(values >= 1.0, np.inf, np.where(values <= 0.0, -np.inf, found)))
