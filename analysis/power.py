"""What simulations of power share: how many participants to try, and which number suffices."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

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
