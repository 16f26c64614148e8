"""Weighted pull-push, in numpy.

Source: "20090110 - Hole Filling", a note on reprojection rendering. One weight steers it
all, ``1 / quality^2`` (small quality values mean good pixels), and it counts squared: when
four pixels are averaged into one, and when a level is blended with the next coarser one.
Sparse data of "super" quality outweighs its surroundings, and so spreads over them; the
weight itself is averaged plainly, so that it thins out and the spreading ends
(docs/decisions/0044).

The last shown frame comes back into the holes of the next: it is reprojected along the filled
motion and merged with the new one at a lower quality, and holes are filled from both. The note
recirculates what was drawn, without its fill. Views of one source frame all draw the same, so here
the fill comes back too. Depth and motion need no fill: the warp gives holes their background's. The
frame is kept by places of the source, as plate/reference.py keeps fills, but each view writes what
it shows over what was there (twin: `PlatePass` of plate/gpu.py).

Twin: gpu.py with reduce.comp.glsl and expand.comp.glsl. Change both or neither.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import Floats, WarpedFrame
from pipeline.plate.reference import KeptFills
from pipeline.pushpull.reference import upsample


def reduce(fine: NDArray[np.floating]) -> Floats:
    """Average 2x2 pixels into one, each counting with its squared weight.

    Parameters
    ----------
    fine : ndarray of shape (H, W, 4)
        Encoded RGB, then weight, at least 0; 0 means unknown.

    Returns
    -------
    ndarray of shape (ceil(H / 2), ceil(W / 2), 4)
        Colour ``sum w^2 c / sum w^2`` and the mean weight. Unknown pixels are all zero. The
        last row or column of an odd level repeats, so that its weight does not shrink.
    """
    height, width, _ = fine.shape
    padded = np.pad(fine.astype(np.float64), ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    taps = padded.reshape((height + 1) // 2, 2, (width + 1) // 2, 2, 4)
    square = taps[..., 3:] ** 2
    total = square.sum(axis=(1, 3))
    colour = (square * taps[..., :3]).sum(axis=(1, 3)) / np.where(total > 0, total, 1.0)
    return np.concatenate([colour, taps[..., 3:].mean(axis=(1, 3))], axis=-1)


def expand(fine: NDArray[np.floating], coarse: NDArray[np.floating]) -> Floats:
    """Blend one level with the next coarser one by the clamped ratio of squared weights.

    Parameters
    ----------
    fine : ndarray of shape (H, W, 4)
        Encoded RGB, then weight.
    coarse : ndarray of shape (ceil(H / 2), ceil(W / 2), 4)
        The next level, expanded already.

    Returns
    -------
    ndarray of shape (H, W, 4)
        ``share * fine + (1 - share) * below``, weight included, where ``below`` is one
        bilinear fetch of `coarse` and ``share = min(1, (w_fine / w_below)^2)``: a pixel
        that weighs at least as much as its surroundings stays as it is.
    """
    below = upsample(coarse, (fine.shape[0], fine.shape[1]))
    ours, theirs = fine[..., 3:].astype(np.float64) ** 2, below[..., 3:] ** 2
    share = np.where(ours >= theirs, 1.0, ours / np.where(theirs > 0, theirs, 1.0))
    return np.asarray(share * fine + (1 - share) * below)


def weighted_pull_push(image: NDArray[np.floating]) -> Floats:
    """Fill the unknown pixels of an image of any size.

    Parameters
    ----------
    image : ndarray of shape (H, W, 4)
        Encoded RGB, then weight ``1 / quality^2``; 0 means unknown.

    Returns
    -------
    ndarray of shape (H, W, 3)
        Every value within the range of the known ones. Where all known pixels weigh the
        same they are unchanged.

    Raises
    ------
    InputError
        If no pixel is known, or a weight is negative or not finite.
    """
    weight = image[..., 3]
    if not (np.isfinite(weight).all() and (weight >= 0).all()):
        raise InputError("weights must be finite and at least 0 (got negative, NaN or infinite)")
    if not (weight > 0).any():
        raise InputError(
            f"image must have at least one known pixel (all {weight.size} are unknown)"
        )
    levels = [image.astype(np.float64)]
    while levels[-1].shape[:2] != (1, 1):
        levels.append(reduce(levels[-1]))
    filled = levels.pop()
    while levels:
        filled = expand(levels.pop(), filled)
    return filled[..., :3]


SAME_SURFACE = 0.04  # depths that differ by a larger share of the greater one are of two surfaces


def recirculating(weight: float) -> KeptFills:
    """Return the fill of views of one source frame from what they know and what was shown.

    Parameters
    ----------
    weight : float
        Of what was shown before, ``1 / quality^2``; what is known weighs 1. Above 0.
    """
    return KeptFills(_filled, SAME_SURFACE, weight=weight, overwrites=True)


def _filled(frame: WarpedFrame, weight: Floats) -> NDArray[np.float32]:
    return weighted_pull_push(np.dstack([frame.colour, weight])).astype(np.float32)
