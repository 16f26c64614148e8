"""Answer rules: the share of right answers as a function of d', and back.

Each is an ideal observer of detection theory. A task names its rule (`rule` of
`protocols.tasks.single.RightOrWrong`); statistics, power and artificial observers take it from
here. Functions take and return arrays. A share below chance gives a negative d': noise around
chance then averages out, instead of being folded to the positive side.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from protocols.adaptive.psychometric_function import Floats
from protocols.errors import must_be_one_of
from protocols.plugins import named

ROOT_2, ROOT_6 = float(np.sqrt(2.0)), float(np.sqrt(6.0))
LARGEST_D_PRIME = 12.0


class AnswerRule(ABC):
    """Decision of an unbiased observer, from which the share of right answers follows.

    Parameters
    ----------
    words : str
        Name in reports.
    chance : float
        Share of right answers where d' is 0.
    """

    def __init__(self, words: str, chance: float) -> None:
        self.words, self.chance = words, chance

    @abstractmethod
    def share(self, d_prime: ArrayLike) -> Floats:
        """Return the share of right answers, which rises with d'."""

    def d_prime(self, share: ArrayLike) -> Floats:
        """Return d' of a share of right answers; negative below chance."""
        values = np.asarray(share, dtype=np.float64)
        return _inverse(self.share, values, -LARGEST_D_PRIME, LARGEST_D_PRIME)


class Alternatives(AnswerRule):
    """One of m alternatives, each of them equally likely, gives the largest value.

    p = integral of phi(x - d) Phi(x)^(m - 1) dx: the right alternative gives the largest of m
    independent normal values (Green and Swets 1966; Hacker and Ratcliff 1979). For m = 2 it is
    Phi(d / sqrt 2).
    """

    def __init__(self, alternatives: int) -> None:
        if alternatives < 2:
            raise ValueError(f"alternatives must be at least 2 (got {alternatives})")
        super().__init__(f"{alternatives} alternatives", 1.0 / alternatives)
        self._others = alternatives - 1

    def share(self, d_prime: ArrayLike) -> Floats:
        """Return the share of right answers."""
        d = np.asarray(d_prime, dtype=np.float64)
        if self._others == 1:
            return np.asarray(ndtr(d / ROOT_2))
        x, step = np.linspace(-9.0, 9.0, 721, retstep=True)
        density = np.exp(-(x**2) / 2.0) / np.sqrt(2.0 * np.pi)
        values = density * ndtr(x + d[..., None]) ** self._others
        return np.asarray(values.sum(axis=-1) * step)

    def d_prime(self, share: ArrayLike) -> Floats:
        """Return d' of a share of right answers; negative below chance."""
        if self._others == 1:
            return np.asarray(ROOT_2 * ndtri(np.asarray(share, dtype=np.float64)))
        return super().d_prime(share)


class EqualSigns(AnswerRule):
    """Two normal quantities, with means d', must have one sign for a right answer.

    ``differencing``: X is called A where abs(X - A) < abs(X - B), so the observer compares
    distances of single observations:
    p = Phi(d / sqrt 2) Phi(d / sqrt 6) + Phi(-d / sqrt 2) Phi(-d / sqrt 6).
    ``independent``: the optimal rule for two fixed stimuli; X and the difference A - B are judged
    apart: p = Phi(d / sqrt 2) Phi(d / 2) + Phi(-d / sqrt 2) Phi(-d / 2).
    ``dual-pair``: not ABX; of two pairs of observations one differs, and the pair with the larger
    difference is chosen, as where one half of a picture changes and the other does not:
    p = Phi(d / 2)^2 + Phi(-d / 2)^2.

    Negative d': answers are wrong as often as they would be right at its size.

    Notes
    -----
    Macmillan and Creelman 2005, "Detection Theory", 2nd ed., chapter 9; Hautus and Meng 2002,
    Perception and Psychophysics 64(1), who found observers to take differences. Freeman and
    Simoncelli 2011 use the independent rule. Dual pair: Rousseau and Ennis 2001, Perception and
    Psychophysics 63(6); the sum and the difference of the two differences are independent, each of
    deviation 2.

    Near chance the share rises with the square of d', so its Fisher information about d' is 0
    at d' = 0, and the size of d' of noisy shares follows a folded law like Rice's: always above 0.
    The analysis plan of our studies asks for a "Fisher-Rice-corrected d'". No source has that
    phrase. We read it as the correction of these two biases, and make it so: the sign of
    share - 1/2 is kept, so that noise is not folded (Rice), and one trial at chance is added
    to every condition's count (`analysis.models.detection.corrected_share`), which is the penalty
    of Firth and Hautus for a share without finite estimate.
    """

    def __init__(self, words: str, deviations: tuple[float, float], _alternatives: int = 2) -> None:
        super().__init__(words, 0.5)
        self._deviations = deviations

    def share(self, d_prime: ArrayLike) -> Floats:
        """Return the share of right answers."""
        size = np.abs(np.asarray(d_prime, dtype=np.float64))
        first, other = ndtr(size / self._deviations[0]), size / self._deviations[1]
        share = first * ndtr(other) + (1.0 - first) * ndtr(-other)
        return np.asarray(0.5 + np.sign(d_prime) * (share - 0.5))

    def d_prime(self, share: ArrayLike) -> Floats:
        """Return d' of a share of right answers; negative below one half."""
        share = np.asarray(share, dtype=np.float64)
        size = _inverse(self.share, 0.5 + np.abs(share - 0.5), 0.0, LARGEST_D_PRIME)
        return np.asarray(np.sign(share - 0.5) * size)


RULES: Mapping[str, Callable[[int], AnswerRule]] = {
    "alternatives": Alternatives,
    "differencing": partial(EqualSigns, "ABX, differencing rule", (ROOT_2, ROOT_6)),
    "independent": partial(EqualSigns, "ABX, independent rule", (ROOT_2, 2.0)),
    "dual-pair": partial(EqualSigns, "dual-pair rule", (2.0, 2.0)),
}
"""Makers of rules by name, each from the number of alternatives."""


def answer_rule(name: str, alternatives: int = 2) -> AnswerRule:
    """Return a rule by its name.

    Parameters
    ----------
    name : str
        One of `RULES`, or ``module:NAME`` of what makes one from the number of alternatives, as
        the task of a plug-in names its own.

    Raises
    ------
    ValueError
        If there is none of that name.
    """
    if ":" in name:
        made = named(name)(alternatives)
        if not isinstance(made, AnswerRule):
            raise ValueError(f"{name} must make a protocols.answer_rules.AnswerRule (got {made!r})")
        return made
    if name not in RULES:
        raise ValueError(must_be_one_of("rule", name, RULES))
    return RULES[name](alternatives)


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
