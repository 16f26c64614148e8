"""One fixation of one picture, and what pictures must be."""

from __future__ import annotations

import operator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.foveation.geometry import Geometry, check_edges, check_gaze
from pipeline.foveation.pooling import Pooling, Pools
from pipeline.frame import AnyArray, check_seed

Colour = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class PictureFixation:
    """One fixation of one picture.

    Parameters
    ----------
    geometry : Geometry
        Of the picture's size.
    gaze_px : (x, y)
        Where the eye looks, also off the picture.
    seed : int
        From 0 to 2**63 - 1. Both eyes, and all frames of a clip, share one.
    frame : int
        Number of the picture in its clip; what is made elsewhere is found by it.
    noise_shift_px : ndarray of shape (H, W, 2), optional
        How far each pixel's surface has moved since noise was laid on it; (x, y) shows the noise of
        (x, y) - shift. In a right eye it is the disparity. By default noise lies on the screen.
    field_gaze_px : (x, y), optional
        The gaze that a displacement follows; by default `gaze_px`. See `SteadyGaze`.
    """

    geometry: Geometry
    gaze_px: tuple[float, float]
    seed: int = 0
    frame: int = 0
    noise_shift_px: NDArray[np.floating] | None = None
    field_gaze_px: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "gaze_px", check_gaze(self.geometry, self.gaze_px))
        check_seed(self.seed)
        if self.field_gaze_px is not None:
            check_gaze(self.geometry, self.field_gaze_px)
        if self.noise_shift_px is not None:
            self._check_shift(self.noise_shift_px)

    def _check_shift(self, shift_px: NDArray[np.floating]) -> None:
        wanted = (self.geometry.height_px, self.geometry.width_px, 2)
        if shift_px.shape != wanted:
            raise InputError(f"noise_shift_px must have shape {wanted} (got {shift_px.shape})")
        if not np.isfinite(shift_px).all():
            raise InputError("noise_shift_px must be finite (got NaN or infinity)")

    def pools(self, pooling: Pooling) -> Pools:
        """The pools of this gaze."""
        return Pools(self.geometry, self.gaze_px, pooling)

    def field_pools(self, pooling: Pooling) -> Pools:
        """The pools that a displacement follows."""
        return Pools(self.geometry, self.field_gaze_px or self.gaze_px, pooling)


def float_picture(picture: NDArray[np.floating]) -> Colour:
    """Return a picture as float32.

    Raises
    ------
    InputError
        If it is not of shape (H, W, 3), not of a floating type, or leaves [0, 1].
    """
    array = np.asarray(picture)
    if array.ndim != 3 or array.shape[2] != 3 or min(array.shape) < 1:
        raise InputError(
            f"picture must be of shape (H, W, 3), encoded red, green, blue (got {array.shape});"
            " repeat a grey picture three times, and put a transparent one on a background first"
        )
    if not np.issubdtype(array.dtype, np.floating):
        raise InputError(
            f"picture must be of a floating type in [0, 1] (got {array.dtype});"
            " divide 8-bit values by 255 and 16-bit ones by 65535"
        )
    bad = ~(np.isfinite(array) & (array >= 0) & (array <= 1))
    if bad.any():
        raise InputError(
            f"picture must lie in [0, 1] (got {array[bad].flat[0]}, and {int(bad.sum())} such"
            " values in all); encode and clip light of high dynamic range first"
        )
    return np.ascontiguousarray(array, np.float32)


def check_held(picture: AnyArray) -> Colour | NDArray[np.uint8]:
    """Return a picture (H, W, 3) of 8 bits as it is, any other as `float_picture` does."""
    array = np.asarray(picture)
    if array.dtype == np.uint8 and array.ndim == 3 and array.shape[2] == 3:
        return array
    return float_picture(array)


def check_picture_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return (height, width) as two whole numbers, at least 1.

    Raises
    ------
    InputError
        If it is anything else.
    """
    try:
        height, width = (operator.index(edge) for edge in size)
    except (TypeError, ValueError):
        raise InputError(
            f"size must be (height, width), two whole numbers (got {size!r}); of a picture it is"
            " picture.shape[:2]"
        ) from None
    check_edges(width, height)
    return height, width
