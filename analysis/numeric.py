"""Numerical derivatives, for standard errors where no formula is at hand."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def numeric_hessian(
    function: Callable[[Floats], float], point: Floats, step: float = 1e-4
) -> Floats:
    """Return second derivatives by central differences, steps relative to each value."""
    size = point.size
    steps = step * np.maximum(1.0, np.abs(point))
    hessian = np.zeros((size, size))
    centre = function(point)
    for i in range(size):
        for j in range(i, size):
            up, down = np.zeros(size), np.zeros(size)
            up[i], down[j] = steps[i], steps[j]
            if i == j:
                value = function(point + up) - 2.0 * centre + function(point - up)
                hessian[i, i] = value / steps[i] ** 2
                continue
            value = function(point + up + down) - function(point + up - down)
            value += function(point - up - down) - function(point - up + down)
            hessian[i, j] = hessian[j, i] = value / (4.0 * steps[i] * steps[j])
    return hessian


def numeric_gradient(
    function: Callable[[Floats], float], point: Floats, step: float = 1e-5
) -> Floats:
    """Return first derivatives by central differences, steps relative to each value."""
    steps = np.diag(step * np.maximum(1.0, np.abs(point)))
    return np.array(
        [(function(point + row) - function(point - row)) / (2.0 * row.sum()) for row in steps]
    )


def newton_polish(function: Callable[[Floats], float], point: Floats, step: float = 1e-3) -> Floats:
    """Finish a quasi-Newton minimisation with two Newton steps on numeric derivatives."""
    for _ in range(2):
        inverse = np.linalg.pinv(numeric_hessian(function, point, step), hermitian=True)
        candidate = point - inverse @ numeric_gradient(function, point)
        if not np.all(np.isfinite(candidate)) or function(candidate) > function(point):
            break
        point = candidate
    return point
