"""What simulations of power share: how many participants to try, and which number suffices."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from scipy.special import expit

Floats = NDArray[np.float64]


def default_participants(planned: int | None) -> tuple[int, ...]:
    """Return the numbers of participants a curve shows: 4 to 40, wider for larger plans."""
    top = max(40, 2 * (planned or 0))
    step = max(1, top // 40)
    wanted = {*range(4, top, step), top, planned or top}
    return tuple(sorted(people for people in wanted if people > 1))


def first_reaching(participants: Sequence[int], curve: Floats, goal: float) -> int | None:
    """Return the smallest number from which the smoothed, rising curve stays above `goal`."""
    rising = optimize.isotonic_regression(curve).x
    above = np.nonzero(rising >= goal)[0]
    return int(participants[above[0]]) if above.size else None


def errs_too_often(
    participants: Sequence[int], false_positives: Floats, alpha: float, studies: int
) -> list[str]:
    """Say if the test errs more than twice as often as alpha allows, beyond chance of `studies`."""
    worst, doubled = int(np.argmax(false_positives)), 2 * alpha
    if false_positives[worst] <= doubled + 3 * np.sqrt(doubled * (1 - doubled) / studies):
        return []
    return [
        "do not plan by these numbers: in this design the test errs too often. With nothing to"
        f" find, {false_positives[worst]:.2f} of studies of {participants[worst]} participants are"
        f" significant all the same, at alpha {alpha:g}. Add scenes"
    ]


def mean_logit(rate: float, spread: float) -> float:
    """Return the logit whose mean response over normal effects of sd `spread` is `rate`."""
    if spread == 0:
        return float(np.log(rate / (1.0 - rate)))
    nodes, weights = np.polynomial.hermite_e.hermegauss(41)
    weights = weights / weights.sum()
    return float(
        optimize.brentq(lambda mu: weights @ expit(mu + spread * nodes) - rate, -60.0, 60.0)
    )
