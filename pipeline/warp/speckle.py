"""Outliers of measured depth, mended at the source.

A hole takes the farthest depth of the quads that tore there, so one wrong pixel beside it decides
the whole of it. Measured depth has such pixels, alone and in small clumps, most of all along
silhouettes. They take depth and motion from around them before anything is warped. Rendered depth
is right, and is left alone.

Both twins of the warp are given what is mended here: there is no twin of this.
"""

import numpy as np
from numpy.typing import NDArray

LEAST_ALIKE = 12  # pixels of the 7x7 around one, itself included, that bear it out
WINDOW_PX = 3  # pixels this far along rows and columns are in the window
WIDER_PX = (3, 6, 12)  # windows in which a mend is looked for, in turn
SAME_SURFACE = 0.04  # steps of 1 - z_near / z up to this are of one surface
NEAR_PERCENTILE = 1.0  # of depth, for z_near: outliers do not set it

Bools = NDArray[np.bool_]


def taken(
    plane: NDArray[np.float32], pixel: NDArray[np.intp], source: NDArray[np.intp]
) -> NDArray[np.float32]:
    """Copy a plane, with what it has at `source` put at `pixel`, each (N, 2)."""
    result = plane.copy()
    result[tuple(pixel.T)] = plane[tuple(source.T)]
    return result


def mends(depth_m: NDArray[np.float32]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Tell which pixels are outliers and which pixel each is to be like, (N, 2) each.

    That is the median, in depth, of what is no outlier in the smallest window of `WIDER_PX` that
    holds any. An outlier without one stays as it is.
    """
    bad = outliers(depth_m)
    reach = max(WIDER_PX)
    good = np.pad(~bad, reach)
    padded = np.pad(depth_m, reach)
    pixels, sources = [], []
    for row, column in np.argwhere(bad):
        for around in WIDER_PX:
            corner = np.array([row, column]) + reach - around
            window = tuple(slice(start, start + 2 * around + 1) for start in corner)
            place = np.argwhere(good[window])
            if len(place):
                depths = padded[window][tuple(place.T)]
                middle = place[np.argsort(depths, kind="stable")[len(place) // 2]]
                pixels.append((row, column))
                sources.append(middle + corner - reach)
                break
    empty = np.zeros((0, 2), np.intp)
    return (np.array(pixels, np.intp), np.array(sources, np.intp)) if pixels else (empty, empty)


def outliers(depth_m: NDArray[np.float32]) -> Bools:
    """Tell which pixels nothing around them bears out, shape (H, W).

    A pixel is one of its surface's if at least `LEAST_ALIKE` of the 7x7 around it have its depth,
    or if three steps over pixels of its depth lead out of the 5x5 around it: thin things, such as
    spokes, wires and what is seen between them, go on beyond.
    """
    finite = depth_m[np.isfinite(depth_m)]
    near_m = np.percentile(finite, NEAR_PERCENTILE) if finite.size else 1.0
    guide = np.pad(1 - near_m / depth_m.astype(np.float64), WINDOW_PX, constant_values=np.nan)
    height, width = depth_m.shape

    def alike(pixel: NDArray[np.intp], step: tuple[int, int]) -> Bools:
        place = pixel + WINDOW_PX
        here, there = guide[tuple(place.T)], guide[tuple((place + step).T)]
        return np.abs(here - there) <= SAME_SURFACE  # NaN beyond the frame's edge is not

    pixel = np.argwhere(np.ones((height, width), np.bool_))
    for side in ((0, 1), (1, 0), (0, -1), (-1, 0)):  # most pixels go on straight
        straight = np.ones(len(pixel), np.bool_)
        for count in range(1, WINDOW_PX + 1):
            straight &= alike(pixel, (count * side[0], count * side[1]))
        pixel = pixel[~straight]
    edge = 2 * WINDOW_PX + 1
    window = np.zeros((len(pixel), edge + 2, edge + 2), np.bool_)
    for y in range(edge):
        for x in range(edge):
            window[:, y + 1, x + 1] = alike(pixel, (y - WINDOW_PX, x - WINDOW_PX))
    inner = window[:, 1:-1, 1:-1]
    reached = np.zeros_like(window)
    reached[:, WINDOW_PX + 1, WINDOW_PX + 1] = True
    for _ in range(WINDOW_PX):
        beside = [
            reached[:, y : y + edge, x : x + edge] for y in range(3) for x in range(3)
        ]
        reached[:, 1:-1, 1:-1] = np.logical_or.reduce(beside) & inner
    reached[:, 2:-2, 2:-2] = False
    lonely = (inner.sum(axis=(1, 2)) < LEAST_ALIKE) & ~reached.any(axis=(1, 2))
    result = np.zeros((height, width), np.bool_)
    result[tuple(pixel[lonely].T)] = True
    return result
