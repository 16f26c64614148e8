"""Depth-guided pull and push.

Kuffner dos Anjos et al. 2022, section 3.3 and Alg. 1, with the mends of docs/method.md:
colour is normalised by its weights, `mix` takes its operands in order, "farthest" is the
largest depth, and push is guided by depth as well as pull.

Depth here is `guide = 1 - z_near / z`: 0 at the nearest point, 1 at infinity, linear in
parallax, so that one threshold means the same number of pixels everywhere.

Validity above 0 is confidence. 0: nothing is known. `ONLY_NEARER`: something is known,
but all of it lies in front of the guide; it serves where the whole image has nothing else.

Twin: guided.glsl and the passes of gpu.py. Change both or neither.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.features.reference import grow, parents
from pipeline.frame import Bools, Floats
from pipeline.inpaint.regions import CELL, SOURCE_RINGS, source_resolution

ONLY_NEARER = -1.0
# Colour is relaxed in these finest resolutions, pixel by pixel and 2x2 by 2x2 up to 32x32: what is
# pushed alone is blocky, and meets the hole's border in a step.
RELAXED_RESOLUTIONS = 6


@dataclass(frozen=True, eq=False)
class GuidedLevel:
    """One level of a guided pyramid."""

    values: Floats  # (H, W, n)
    validity: Floats  # (H, W)
    guide: Floats  # (H, W)


def nearest_depth_m(depth_m: NDArray[np.floating]) -> float:
    """Return the nearest depth of a frame, for a guide of its own; 1 m if all is at infinity."""
    nearest = float(depth_m.min())
    return nearest if np.isfinite(nearest) else 1.0


def guide_from_depth(depth_m: NDArray[np.floating], z_near_m: float) -> Floats:
    """Map depth to [0, 1]: 0 at `z_near_m` (finite; and nearer), 1 at infinity."""
    return np.asarray(np.maximum(0.0, 1.0 - z_near_m / depth_m.astype(np.float64)))


def pull(fine: GuidedLevel, threshold: float) -> GuidedLevel:
    """Average each 2x2's known children that are no nearer than its farthest one.

    Alg. 1, PULL. Values and validity of all orientations and channels go together.
    """
    values, validity, guide = (
        children(array) for array in (fine.values, fine.validity, fine.guide)
    )
    deepest = guide.max(axis=2)
    behind = deepest[:, :, None] - guide <= threshold
    weight = np.where(behind & (validity > 0), validity, 0.0)
    total = weight.sum(axis=2)
    anything = (validity != 0).astype(np.float64)
    mean = _mean(values, np.where(total[:, :, None] > 0, weight, anything))
    confidence = np.where(total > 0, total / 4, np.where(anything.any(axis=2), ONLY_NEARER, 0.0))
    return GuidedLevel(mean, confidence, deepest)


def push(fine: GuidedLevel, coarse: GuidedLevel, gamma: float, threshold: float) -> GuidedLevel:
    """Complete `fine` with `coarse`: ``mix(coarse, fine, validity ** gamma)``.

    Alg. 1, PUSH, with the operands of `mix` in order. gamma 0 keeps whatever is valid at
    all (classic push-pull), 1 blends by confidence. Push is guided by depth as pull is:
    a pixel that finds nothing of its own depth below keeps what it has.
    """
    below, similar = interpolate(coarse, fine.guide, threshold)
    known = fine.validity > 0
    confidence = np.where(known, np.where(similar, np.abs(fine.validity) ** gamma, 1.0), 0.0)
    values = confidence[..., None] * fine.values + (1 - confidence[..., None]) * below
    return GuidedLevel(values, fine.validity, fine.guide)


def interpolate(coarse: GuidedLevel, guide: Floats, threshold: float) -> tuple[Floats, Bools]:
    """Interpolate a level bilinearly at twice its size, guided by depth; see `guided_mean`."""
    rows, columns = (
        parents(length, coarse.guide.shape[axis]) for axis, length in enumerate(guide.shape)
    )
    shares = np.full((*guide.shape, 2, 2), [[9.0, 3.0], [3.0, 1.0]])
    return guided_mean(coarse, rows, columns, shares, guide, threshold)


def guided_mean(
    coarse: GuidedLevel,
    rows: Sequence[NDArray[np.intp]],
    columns: Sequence[NDArray[np.intp]],
    shares: Floats,
    guide: Floats,
    threshold: float,
) -> tuple[Floats, Bools]:
    """Average four neighbours of a coarse level, those of the pixel's own depth only.

    Where none is within the threshold of its depth, those that are not nearer; where all
    are nearer (which no pixel near a hole is), zero.

    Parameters
    ----------
    rows, columns : two arrays of shape (H,) and (W,) each
        Indices of the neighbours.
    shares : (H, W, 2, 2)
        Bilinear weights, by row and column; any scale.
    threshold : float
        How much nearer or farther than the pixel a neighbour of its own depth may be.

    Returns
    -------
    values : (H, W, n)
    similar : (H, W) of bool
        Whether a neighbour of the pixel's own depth was found.
    """
    places = [(i, j) for i in range(2) for j in range(2)]
    step = np.stack([guide - coarse.guide[rows[i]][:, columns[j]] for i, j in places], axis=-1)
    share = np.stack([shares[..., i, j] for i, j in places], axis=-1)
    same = share * (np.abs(step) <= threshold)
    similar = same.sum(axis=-1) > 0
    weight = np.where(similar[..., None], same, share * (step <= threshold))
    total = weight.sum(axis=-1, keepdims=True)
    weight = np.divide(weight, total, out=np.zeros_like(weight), where=total > 0)
    values = sum(
        weight[..., n, None] * coarse.values[rows[i]][:, columns[j]]
        for n, (i, j) in enumerate(places)
    )
    return np.asarray(values), similar


def relax(level: GuidedLevel, gamma: float, threshold: float) -> GuidedLevel:
    """Draw what is not wholly known towards the mean of its four neighbours.

    One step of Gauss and Seidel for Laplace's equation, of which push is a first guess: first all
    pixels whose row and column add up to an even number, then, with those at hand, the others. A
    pixel keeps ``validity ** gamma`` of what it is, and all of it where no neighbour is of its own
    depth. Outside a frame its border goes on.
    """
    own = np.where(level.validity > 0, np.abs(level.validity) ** gamma, 0.0)
    odd = np.add.outer(*map(np.arange, level.guide.shape)) % 2
    steps = np.abs(level.guide - np.stack(_neighbours(level.guide)))
    share = (steps <= threshold).astype(np.float64)
    total = share.sum(axis=0)
    share = np.divide(share, total, out=np.zeros_like(share), where=total > 0)
    values = level.values
    for parity in (0, 1):
        mean = sum(
            part[..., None] * found for part, found in zip(share, _neighbours(values), strict=True)
        )
        drawn = own[..., None] * values + (1 - own[..., None]) * mean
        values = np.where(((odd == parity) & (total > 0))[..., None], drawn, values)
    return GuidedLevel(values, level.validity, level.guide)


def _neighbours(array: Floats) -> list[Floats]:
    """Neighbours of each pixel to the left, right, above and below; borders repeat."""
    height, width = array.shape[:2]
    rows, columns = np.arange(height), np.arange(width)
    return [
        array[:, np.maximum(columns - 1, 0)],
        array[:, np.minimum(columns + 1, width - 1)],
        array[np.maximum(rows - 1, 0)],
        array[np.minimum(rows + 1, height - 1)],
    ]


def pull_push(
    level: GuidedLevel, gamma: float, threshold: float, relaxed: int = 0
) -> list[GuidedLevel]:
    """Pull to 1x1, at least once, and push back; the completed levels, finest first.

    The `relaxed` finest are relaxed as soon as they are pushed into; see `RELAXED_RESOLUTIONS`.
    """
    levels = [level, pull(level, threshold)]
    while levels[-1].validity.shape != (1, 1):
        levels.append(pull(levels[-1], threshold))
    for index in reversed(range(len(levels) - 1)):
        levels[index] = push(levels[index], levels[index + 1], gamma, threshold)
        if index < relaxed:
            levels[index] = relax(levels[index], gamma, threshold)
    return levels


def near_a_hole(hole: Bools, cell_resolution: int, rings: int, tile_resolution: int) -> Bools:
    """Return True for pixels near a hole, in cells of the pyramid (regions.py).

    Those are whole cells of `tile_resolution` that overlap a cell of `cell_resolution` within
    `rings` cells of one that holds a hole pixel.
    """
    edge = CELL << cell_resolution
    near = grow(_blocks(hole, edge), rings).repeat(edge, axis=0).repeat(edge, axis=1)
    tile = CELL << tile_resolution
    height, width = hole.shape
    tiles = _blocks(near[:height, :width], tile)
    return tiles.repeat(tile, axis=0).repeat(tile, axis=1)[:height, :width]


def _blocks(mask: Bools, edge: int) -> Bools:
    """Return True for squares of `edge` pixels that hold a True."""
    height, width = mask.shape
    rows, columns = -(-height // edge), -(-width // edge)
    padded = np.pad(mask, ((0, rows * edge - height), (0, columns * edge - width)))
    blocks = padded.reshape(rows, edge, columns, edge)
    return np.asarray(np.logical_or.reduce(blocks, axis=(1, 3)))


def guided_base(
    colour: NDArray[np.floating],
    hole: Bools,
    guide: Floats,
    *,
    levels: int,
    gamma: float,
    threshold: float,
) -> list[GuidedLevel]:
    """Fill colour from the background; the levels, finest first.

    Pixels far from every hole take no part: unknown, and nearest, so that no maximum sees
    them.
    """
    source = source_resolution(levels)
    near = near_a_hole(hole, source, SOURCE_RINGS, source)
    values = colour.astype(np.float64)
    known = (near & ~hole).astype(np.float64)
    level = GuidedLevel(values, known, np.where(near, guide, 0.0))
    return pull_push(level, gamma, threshold, RELAXED_RESOLUTIONS)


def children(array: Floats) -> Floats:
    """(H, W, ...) to (ceil(H / 2), ceil(W / 2), 4, ...); odd borders repeat."""
    height, width = array.shape[:2]
    rows = np.minimum(2 * np.arange((height + 1) // 2)[:, None] + np.arange(2), height - 1)
    columns = np.minimum(2 * np.arange((width + 1) // 2)[:, None] + np.arange(2), width - 1)
    return np.stack(
        [array[rows[:, i]][:, columns[:, j]] for i in range(2) for j in range(2)], axis=2
    )


def _mean(values: Floats, weight: Floats) -> Floats:
    total = weight.sum(axis=2)
    summed = (weight[..., None] * values).sum(axis=2)
    known = total[..., None] > 0
    return np.asarray(np.divide(summed, total[..., None], out=np.zeros_like(summed), where=known))
