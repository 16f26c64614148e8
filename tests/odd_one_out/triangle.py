"""The triangle: one of three stimuli is odd."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from protocols.adaptive.psychometric_function import Floats
from protocols.answer_rules import AnswerRule


class Triangle(AnswerRule):
    """The odd one is taken to be the one that is not among the nearest two.

    p = 2 integral from 0 of (Phi(-x sqrt 3 + d sqrt(2/3)) + Phi(-x sqrt 3 - d sqrt(2/3))) phi(x)
    dx, 1/3 at 0 (Ennis 1993, Journal of Sensory Studies 8). Negative d': answers are as far below.
    """

    def __init__(self, _alternatives: int) -> None:
        super().__init__("odd one out of three", 1 / 3)

    def share(self, d_prime: ArrayLike) -> Floats:
        """Return the share of right answers."""
        size = np.abs(np.asarray(d_prime, dtype=np.float64)) * np.sqrt(2.0 / 3.0)
        x, weight = np.polynomial.legendre.leggauss(80)
        x, weight = 4.5 * (x + 1.0), 4.5 * weight
        near = x * np.sqrt(3.0)
        both = ndtr(size[..., None] - near) + ndtr(-size[..., None] - near)
        density = np.exp(-(x**2) / 2.0) / np.sqrt(2.0 * np.pi)
        above = 2.0 * (both * density * weight).sum(axis=-1) - 1 / 3
        return np.asarray(np.clip(1 / 3 + np.where(np.less(d_prime, 0), -1, 1) * above, 0, 1))
