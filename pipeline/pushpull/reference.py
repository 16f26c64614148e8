"""Push-pull as its paper defines it, and weighted push-pull, in numpy.

Gortler, Grzeszczuk, Szeliski and Cohen 1996, "The Lumigraph", section 3.3: pull averages
what is known into ever coarser levels, push brings it back where it is missing.
Kuffner dos Anjos et al. 2022, section 4, use it as the naive approach.

Source of the weighted one: "20090110 - Hole Filling", a note on reprojection rendering. One weight
steers it all, ``1 / quality^2`` (small quality values mean good pixels), and it counts squared:
when four pixels are averaged into one, and when a level is blended with the next coarser one.
Sparse data of "super" quality outweighs its surroundings, and so spreads over them; the weight
itself is averaged plainly, so that it thins out and the spreading ends (docs/decisions/0044).

The last shown frame comes back into the holes of the next: it is reprojected along the filled
motion and merged with the new one at a lower quality, and holes are filled from both. The note
recirculates what was drawn, without its fill. Views of one source frame all draw the same, so here
the fill comes back too. Depth and motion need no fill: the warp gives holes their background's. The
frame is kept by places of the source, as plate/reference.py keeps fills, but each view writes what
it shows over what was there (twin: `PlatePass` of plate/gpu.py).

Twin: gpu.py with the shaders here. Change both or neither.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import Floats, WarpedFrame
from pipeline.plate.reference import KeptFills


def pull(fine: NDArray[np.floating]) -> Floats:
    """Average the known pixels of one level into the next coarser one.

    Parameters
    ----------
    fine : ndarray of shape (H, W, 4)
        Encoded RGB, then confidence in [0, 1]; 0 means unknown.

    Returns
    -------
    ndarray of shape (ceil(H / 2), ceil(W / 2), 4)
        As `fine`. The last row or column of an odd level has fewer children. The
        confidence is the children's sum, at most 1, so a pixel is known as soon as
        one child is. Unknown pixels are all zero.
    """
    height, width, _ = fine.shape
    padded = np.pad(fine.astype(np.float64), ((0, height % 2), (0, width % 2), (0, 0)))
    taps = padded.reshape((height + 1) // 2, 2, (width + 1) // 2, 2, 4)
    weight = taps[..., 3:].sum(axis=(1, 3))
    colour = (taps[..., :3] * taps[..., 3:]).sum(axis=(1, 3))
    known = weight > 0
    mean = np.divide(colour, weight, out=np.zeros_like(colour), where=known)
    return np.concatenate([mean, weight.clip(max=1.0)], axis=-1)


def push(fine: NDArray[np.floating], coarse: NDArray[np.floating]) -> Floats:
    """Complete one level with the next coarser one.

    Parameters
    ----------
    fine : ndarray of shape (H, W, 4)
        Encoded RGB, then confidence.
    coarse : ndarray of shape (ceil(H / 2), ceil(W / 2), 4)
        The completed next level.

    Returns
    -------
    ndarray of shape (H, W, 4)
        ``confidence * fine + (1 - confidence) * coarse``, the coarse level interpolated
        bilinearly; confidence is blended by the same rule, with 1 in place of `fine`.
    """
    weight = fine[..., 3:].astype(np.float64)
    below = upsample(coarse, (fine.shape[0], fine.shape[1]))
    blend = weight * fine[..., :3] + (1 - weight) * below[..., :3]
    colour = np.where(weight < 1, blend, fine[..., :3])  # 1 * -0.0 + 0 would lose its sign
    return np.concatenate([colour, weight + (1 - weight) * below[..., 3:]], axis=-1)


def upsample(coarse: NDArray[np.floating], size: tuple[int, int]) -> Floats:
    """Interpolate `coarse` bilinearly at the pixel centres of a level of twice its size.

    Taps are 3/4 and 1/4 along each axis and repeat at the border.
    """
    result = coarse.astype(np.float64)
    for axis, length in enumerate(size):
        fine_index = np.arange(length)
        near = fine_index // 2
        far = np.clip(near + np.where(fine_index % 2 == 0, -1, 1), 0, coarse.shape[axis] - 1)
        result = 0.75 * result.take(near, axis) + 0.25 * result.take(far, axis)
    return result


def push_pull(image: NDArray[np.floating]) -> Floats:
    """Fill the unknown pixels of an image of any size.

    Parameters
    ----------
    image : ndarray of shape (H, W, 4)
        Encoded RGB, then confidence in [0, 1]; 0 means unknown.

    Returns
    -------
    ndarray of shape (H, W, 3)
        Pixels of confidence 1 unchanged; every value within the range of the known ones.

    Raises
    ------
    InputError
        If the shape, a colour or a confidence is not as said, or no pixel is known.
    """
    if image.ndim != 3 or image.shape[2] != 4 or image.size == 0:
        raise InputError(f"image must be of shape (H, W, 4) (got {image.shape})")
    good = np.isfinite(image).all(axis=-1) & (image[..., 3] >= 0) & (image[..., 3] <= 1)
    if not good.all():
        row, column = np.argwhere(~good)[0]
        raise InputError(
            "image must hold finite colours, also where unknown, and confidences in [0, 1]"
            f" (got {image[row, column]} at row {row}, column {column})"
        )
    if not (image[..., 3] > 0).any():
        raise InputError(
            f"image must have at least one known pixel (all {image[..., 3].size} are unknown)"
        )
    levels = [image.astype(np.float64)]
    while levels[-1].shape[:2] != (1, 1):
        levels.append(pull(levels[-1]))
    filled = levels.pop()
    while levels:
        filled = push(levels.pop(), filled)
    return filled[..., :3]


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


def _filled(frame: WarpedFrame, weight: Floats, _seed: int) -> NDArray[np.float32]:
    return weighted_pull_push(np.dstack([frame.colour, weight])).astype(np.float32)
