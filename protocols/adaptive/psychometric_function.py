"""The psychometric function: how likely a correct answer (or a "yes") is at a level.

``p(x) = guess + (1 - guess - lapse) S(x)``, where the sigmoid S rises from 0 to 1. In a task
with m answers, `guess` is 1/m. In a yes-no task, p is the probability of "yes", and `guess` is
the rate of false alarms.

Two numbers place the sigmoid, and they mean the same for every shape (Schütt et al. 2016,
Vision Research 122, 105-123):

- `threshold`: where S is one half, on the axis of x. This is not where p is one half.
- `width`: the distance on the axis of x from S = .05 to S = .95.

`analysis.models.curves` fits the same two numbers, so a level that an adaptive rule found
and a threshold in the report can be compared directly. Shapes:

==========  ======================================================  =========================
shape       S(x)                                                    width
==========  ======================================================  =========================
gauss       Phi(slope (x - threshold)), slope = 1 / SD              3.290 / slope
logistic    1 / (1 + exp(-slope (x - threshold)))                   5.889 / slope
gumbel      1 - exp(-ln 2 exp(slope (x - threshold)))               4.067 / slope
weibull     1 - exp(-ln 2 (x / threshold) ** slope), for x >= 0     depends on the threshold
==========  ======================================================  =========================

``gumbel`` is the Weibull function for levels that are logarithms, such as log contrast: at
ln(x) and ln(threshold) it equals ``weibull`` with the same slope. ``weibull`` is for levels that
are not. The analysis has gauss, logistic and weibull.
"""

from __future__ import annotations

from typing import TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, ndtr, ndtri

from protocols.adaptive.answer_history import Shape
from protocols.errors import StudyError, must_be_one_of

Floats: TypeAlias = NDArray[np.float64]
SHAPES: tuple[Shape, ...] = get_args(Shape)

WIDTH_EDGE = 0.05
"""The width spans the sigmoid's rise from this share to one minus it."""

# Where the Weibull and Gumbel functions reach .05, .5 and .95, as ln(-ln(1 - S)).
_LOW = float(np.log(-np.log1p(-WIDTH_EDGE)))
_MIDDLE = float(np.log(np.log(2.0)))
_HIGH = float(np.log(-np.log(WIDTH_EDGE)))

_RISE = {
    "gauss": float(2.0 * ndtri(1.0 - WIDTH_EDGE)),
    "logistic": float(2.0 * np.log((1.0 - WIDTH_EDGE) / WIDTH_EDGE)),
    "gumbel": _HIGH - _LOW,
}
"""Slope times width, for each shape in which they do not depend on the threshold."""


def slope_of(width: ArrayLike, shape: Shape, threshold: ArrayLike | None = None) -> Floats:
    """Return the slope of the table above for a width.

    Parameters
    ----------
    width : array_like
        Positive, on the axis of x.
    threshold : array_like or None
        Needed by ``weibull`` alone; it broadcasts with `width`.

    Notes
    -----
    ``weibull`` has no closed form. ``threshold (exp(b / slope) - exp(a / slope)) = width`` with
    a < 0 < b falls steadily with the slope, so 64 halvings of ln(slope) pin it down.
    """
    check_shape(shape)
    span = np.asarray(width, dtype=np.float64)
    if shape != "weibull":
        return np.asarray(_RISE[shape] / span)
    if threshold is None:
        raise ValueError("weibull needs the threshold to turn a width into a slope")
    wanted = span / np.asarray(threshold, dtype=np.float64)
    low = np.full(wanted.shape, np.log(0.02))
    high = np.full(wanted.shape, np.log(1e4))
    for _ in range(64):
        middle = 0.5 * (low + high)
        shallow = _weibull_rise(np.exp(middle)) > wanted
        low, high = np.where(shallow, middle, low), np.where(shallow, high, middle)
    return np.asarray(np.exp(0.5 * (low + high)))


def _weibull_rise(slope: Floats) -> Floats:
    """Return width / threshold of the Weibull function."""
    return np.asarray(np.exp((_HIGH - _MIDDLE) / slope) - np.exp((_LOW - _MIDDLE) / slope))


def sigmoid(level: ArrayLike, threshold: ArrayLike, width: ArrayLike, shape: Shape) -> Floats:
    """Return S(level): .5 at `threshold`, from .05 to .95 over `width`. All arguments broadcast.

    Raises
    ------
    StudyError
        If there is no such shape.
    """
    x = np.asarray(level, dtype=np.float64)
    middle = np.asarray(threshold, dtype=np.float64)
    slope = slope_of(width, shape, middle)
    if shape == "gauss":
        return np.asarray(ndtr(slope * (x - middle)))
    if shape == "logistic":
        return np.asarray(expit(slope * (x - middle)))
    if shape == "gumbel":
        rate = slope * (x - middle) + _MIDDLE
    else:
        with np.errstate(divide="ignore"):
            rate = slope * (np.log(np.maximum(x, 0.0)) - np.log(middle)) + _MIDDLE
    # Past exp(7) nothing is left of the other answer in float64; higher rates would overflow.
    return np.asarray(-np.expm1(-np.exp(np.minimum(rate, 7.0))))


def probability(
    level: ArrayLike,
    *,
    threshold: ArrayLike,
    width: ArrayLike,
    guess: ArrayLike,
    lapse: ArrayLike,
    shape: Shape = "gauss",
    falling: bool = False,
) -> Floats:
    """Return the probability of a correct answer, or of "yes". All arrays broadcast.

    Parameters
    ----------
    level, threshold, width : array_like
        In the unit of the stimulus; `width` is positive.
    guess, lapse : array_like
        Rates in [0, 1).
    falling : bool
        Performance falls with the level, as with eccentricity: S is replaced by 1 - S.

    Raises
    ------
    StudyError
        If there is no such shape.
    """
    rise = sigmoid(level, threshold, width, shape)
    low = np.asarray(guess, dtype=np.float64)
    scale = 1.0 - low - np.asarray(lapse, dtype=np.float64)
    return np.asarray(low + scale * (1.0 - rise if falling else rise))


def check_shape(shape: str) -> None:
    """Refuse a shape that is not in the table above.

    Raises
    ------
    StudyError
    """
    if shape not in SHAPES:
        raise StudyError(must_be_one_of("shape:", shape, SHAPES))
