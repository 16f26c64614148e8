"""A low-pass of what is known of one surface."""

import numpy as np
from numpy.typing import NDArray

REACH = 3  # deviations; beyond, the kernel is cut off


def surface_lowpass(
    values: NDArray[np.floating],
    inside: NDArray[np.bool_],
    guide: NDArray[np.float64],
    sigma_px: float,
    threshold: float,
) -> NDArray[np.float64]:
    """Blur `values` by normalised convolution over `inside`, each pixel over its own surface.

    A separable Gaussian, first along rows, then along columns. A neighbour counts if it lies
    `inside` and within `threshold` of the pixel's own depth, so that nothing crosses a silhouette.

    Parameters
    ----------
    values : (H, W, n)
    inside : (H, W) of bool
    guide : (H, W)
        ``1 - z_near / z``.

    Returns
    -------
    ndarray of float64, shape (H, W, n)
        0 where no neighbour counts.
    """
    summed = np.where(inside[..., None], values.astype(np.float64), 0.0)
    weight = inside.astype(np.float64)
    for axis in (1, 0):
        summed, weight = _along(axis, summed, weight, guide, sigma_px, threshold)
    some = weight[..., None] > 0
    return np.divide(summed, weight[..., None], out=np.zeros_like(summed), where=some)


def _along(
    axis: int,
    summed: NDArray[np.float64],
    weight: NDArray[np.float64],
    guide: NDArray[np.float64],
    sigma_px: float,
    threshold: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    reach = round(REACH * sigma_px)
    length = guide.shape[axis]
    total, total_weight = np.zeros_like(summed), np.zeros_like(weight)
    for step in range(-min(reach, length - 1), min(reach, length - 1) + 1):
        here = _cut(axis, max(0, -step), length - max(0, step))
        there = _cut(axis, max(0, step), length - max(0, -step))
        same = np.abs(guide[there] - guide[here]) <= threshold
        share = np.where(same, np.exp(-0.5 * (step / sigma_px) ** 2), 0.0)
        total[here] += share[..., None] * summed[there]
        total_weight[here] += share * weight[there]
    return total, total_weight


def _cut(axis: int, start: int, stop: int) -> tuple[slice, ...]:
    return (slice(None),) * axis + (slice(start, stop),)
