"""A flip as the eye of a headset sees it: the definition of `study_app/web/src/stage/views.ts`.

The flat screen that `study_app.paint` paints stands straight ahead, at a distance in its own
pixels, and a pinhole sees it: each direction takes the colour that lies between the screen's
pixels, by bilinear interpolation. A panorama is all around, behind it. Only directions count: both
eyes see the same, far away.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from study_app.paint import PixelBytes

Directions = NDArray[np.float64]
"""Unit vectors, shape (rows, columns, 3): x to the right, y up, z to the back."""


def directions(
    size_px: tuple[int, int],
    tangents: tuple[float, float, float, float],
    turn: NDArray[np.float64],
) -> Directions:
    """Return the direction of each pixel's centre of a view, (width, height) large.

    Parameters
    ----------
    tangents : tuple of float
        Of the angles from straight ahead to its left, right, lower and upper edge.
    turn : ndarray of shape (3, 3)
        From the eye's directions to those of the room.
    """
    width, height = size_px
    left, right, down, up = tangents
    x = left + (right - left) * (np.arange(width) + 0.5) / width
    y = up + (down - up) * (np.arange(height) + 0.5) / height
    seen = np.stack([*np.meshgrid(x, y), -np.ones((height, width))], axis=-1)
    unit: Directions = (seen / np.linalg.norm(seen, axis=-1, keepdims=True)) @ turn.T
    return unit


def eye_view(
    rays: Directions,
    screen: PixelBytes,
    distance_px: float,
    background: int,
    panorama: PixelBytes | None = None,
) -> NDArray[np.float64]:
    """Return the colours of directions, 0 to 255, shape (rows, columns, 3).

    Parameters
    ----------
    screen : ndarray of shape (height, width, 3 or 4)
        Of a size in even numbers; RGBA with straight alpha before a panorama.
    background : int
        Grey beyond the screen.
    panorama : ndarray of shape (height, width, 3), optional
        Its middle is straight ahead, its upper edge above.
    """
    behind = np.full((*rays.shape[:2], 3), float(background))
    if panorama is not None:
        rows, columns = panorama.shape[:2]
        right = np.arctan2(rays[..., 0], -rays[..., 2]) / (2 * np.pi) + 0.5
        below = 0.5 - np.arcsin(np.clip(rays[..., 1], -1, 1)) / np.pi
        behind = _between(panorama, columns * right, rows * below, wraps=True)
    height, width = screen.shape[:2]
    ahead = rays[..., 2] < 0
    depth = np.where(ahead, -rays[..., 2], 1.0)
    x = width / 2 + distance_px * rays[..., 0] / depth
    y = height / 2 - distance_px * rays[..., 1] / depth
    alpha = np.ones((height, width)) if screen.shape[2] == 3 else screen[..., 3] / 255
    inked = np.dstack([screen[..., :3] * alpha[..., None], alpha])
    beyond = np.array([*[background] * 3, 1] if panorama is None else [0] * 4)
    inked = beyond + np.pad(inked - beyond, ((2, 2), (2, 2), (0, 0)))
    x, y = x + 2, y + 2
    inside = ahead & (x >= 0) & (x <= inked.shape[1]) & (y >= 0) & (y <= inked.shape[0])
    front = np.where(inside[..., None], _between(inked, x, y), 0.0)
    seen: NDArray[np.float64] = front[..., :3] + behind * (1 - front[..., 3:])
    return seen


def _between(
    image: NDArray[np.float64] | PixelBytes,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    *,
    wraps: bool = False,
) -> NDArray[np.float64]:
    """Return the colours at places of an image, between the centres of its pixels."""
    image = image.astype(np.float64)
    rows, columns = image.shape[:2]
    column, row = np.floor(x - 0.5), np.floor(y - 0.5)
    right, down = (x - 0.5 - column)[..., None], (y - 0.5 - row)[..., None]

    def at(step_x: int, step_y: int) -> NDArray[np.float64]:
        across = (column + step_x).astype(int)
        across = across % columns if wraps else np.clip(across, 0, columns - 1)
        found: NDArray[np.float64] = image[np.clip(row + step_y, 0, rows - 1).astype(int), across]
        return found

    upper = at(0, 0) * (1 - right) + at(1, 0) * right
    lower = at(0, 1) * (1 - right) + at(1, 1) * right
    return upper * (1 - down) + lower * down
