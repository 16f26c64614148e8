"""A stereo pair with disparity, as a source frame and its motion into the other view.

Disparity d of a left pixel at x means that the right view shows it at x - d, so its flow
is (-d, 0); its depth is f b / (d + offset), with the focal length f in pixels, the baseline
b in metres, and the offset between the principal points in pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import SourceFrame, check_colour, check_file_size, check_same_size
from pipeline.pictures.colour_file import load_colour
from pipeline.pictures.depth_and_flow import (
    ASSUMED_FIELD_OF_VIEW,
    Unknown,
    fill_unknown,
    read_disparity,
)
from pipeline.pictures.warp_input import WarpInput
from pipeline.warp.settings import WarpSettings
from protocols.recipes.warped_clips import PHOTOGRAPH_RIM_PX

BUILT_IN: Final = ("motorcycle",)
PAIR_WARP: Final = WarpSettings(rim_px=PHOTOGRAPH_RIM_PX, depth_speckle=True)
"""Warp of a pair where nothing else is asked for."""
# Middlebury 2014 "Motorcycle" at the size that scikit-image ships.
_MOTORCYCLE_FOCAL_PX = 994.978
_MOTORCYCLE_BASELINE_M = 0.193001
_MOTORCYCLE_OFFSET_PX = 31.086
ASSUMED_BASELINE_M = 0.1


@dataclass(frozen=True)
class StereoPair:
    """Two views of one scene, and where each left pixel is in the right one.

    Parameters
    ----------
    left : ndarray of float32, shape (H, W, 3)
        Encoded R'G'B' in [0, 1].
    disparity_px : ndarray of float32, shape (H, W)
        Of the left view, finite everywhere; greater than ``-offset_px``.
    known : ndarray of bool, shape (H, W)
        Where the disparity was measured and not set by `fill_unknown`.
    focal_px, baseline_m, offset_px : float
        The rig; see the module's text.
    right : ndarray of float32, shape (H, W, 3), optional
        The truth to compare a fill with.
    mirrored : bool
        The pair is told from its right photograph: `left` is the right one, with its own
        disparity, `right` the left one, and pixels move the other way.

    Raises
    ------
    InputError
        If sizes differ, a value breaks the rules above, or the rig is not possible.
    """

    left: NDArray[np.float32]
    disparity_px: NDArray[np.float32]
    known: NDArray[np.bool_]
    focal_px: float
    baseline_m: float
    offset_px: float = 0.0
    right: NDArray[np.float32] | None = None
    mirrored: bool = False

    def __post_init__(self) -> None:
        check_colour(self.left, "left")
        arrays = {"left": self.left, "disparity_px": self.disparity_px, "known": self.known}
        if self.right is not None:
            check_colour(self.right, "right")
            arrays["right"] = self.right
        check_same_size(**arrays)
        for name, value in (("focal_px", self.focal_px), ("baseline_m", self.baseline_m)):
            if not value > 0:
                raise InputError(f"{name} must be greater than 0 (got {value})")
        bad = ~(np.isfinite(self.disparity_px) & (self.disparity_px + self.offset_px > 0))
        if bad.any():
            row, column = np.argwhere(bad)[0]
            raise InputError(
                f"disparity must be greater than {0 - self.offset_px:g} px, or the depth is not"
                f" positive (got {self.disparity_px[row, column]} at row {row}, column {column},"
                f" and {int(bad.sum()) - 1} more such pixels); is the offset right?"
            )

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Depth of the left view, shape (H, W)."""
        depth = self.focal_px * self.baseline_m / (self.disparity_px + self.offset_px)
        return depth.astype(np.float32)

    def warp_input(self, amount: float = 1.0) -> WarpInput:
        """Return the left view with its motion towards the right one.

        Parameters
        ----------
        amount : float
            How far along the baseline: 1 is the right view, 0.5 half way to it; beyond 1 and
            below 0 the view leaves the segment between the two cameras.
        """
        flow_px = np.zeros((*self.disparity_px.shape, 2), np.float32)
        flow_px[..., 0] = (amount if self.mirrored else -amount) * self.disparity_px
        return WarpInput(SourceFrame(self.left, self.depth_m, self.known), flow_px)


def built_in_pair(name: str) -> StereoPair:
    """Return a pair that comes with the packages metamerlab needs; nothing is downloaded.

    Raises
    ------
    InputError
        If `name` is not one of `BUILT_IN`.
    """
    if name not in BUILT_IN:
        raise InputError(f"built-in pairs are: {', '.join(BUILT_IN)} (got {name!r})")
    from skimage.data import stereo_motorcycle

    left, right, disparity = stereo_motorcycle()
    filled, known = fill_unknown(np.asarray(disparity, np.float32))
    return StereoPair(
        left=_from_bytes(left),
        right=_from_bytes(right),
        disparity_px=filled,
        known=known,
        focal_px=_MOTORCYCLE_FOCAL_PX,
        baseline_m=_MOTORCYCLE_BASELINE_M,
        offset_px=_MOTORCYCLE_OFFSET_PX,
    )


def load_pair(
    left: Path,
    disparity: Path,
    right: Path | None = None,
    *,
    units_per_px: float = 1.0,
    focal_px: float | None = None,
    baseline_m: float = ASSUMED_BASELINE_M,
    offset_px: float = 0.0,
    unknown: Unknown = None,
) -> StereoPair:
    """Read a stereo pair with the disparity of its left view.

    Parameters
    ----------
    left, right : Path
        Colour images.
    disparity : Path
        An image of one channel (PNG, PGM, PFM, OpenEXR) or a numpy file (``.npy``, or
        ``.npz`` with one array). `pipeline.pictures.depth_and_flow` says which numbers stand for
        "unknown"; these pixels are set as `fill_unknown` says.
    units_per_px : float
        What the file stores for a disparity of one pixel: 4 where it holds quarters of a
        pixel, 1 for pixels.
    focal_px : float, optional
        By default the image's width, a field of view of 53 degrees: then only the order and
        the ratios of depths are right, which is all that filling holes needs.
    baseline_m, offset_px : float
        See the module's text.
    unknown : sequence of float, optional
        Further stored numbers that stand for "unknown"; empty, if there are none.

    Raises
    ------
    FileNotFoundError
        If one of the files is missing.
    InputError
        If a file is not what it must be, sizes differ, no disparity is known, or, without a
        right photograph to say why, one is wider than the picture.
    """
    if not 0 < units_per_px < np.inf:
        raise InputError(f"units_per_px must be greater than 0 and finite (got {units_per_px})")
    colour = load_colour(left)
    stored_px = read_disparity(
        disparity, units_per_px=units_per_px, offset_px=offset_px, unknown=unknown
    )
    check_file_size(disparity, stored_px, left, colour)
    other = None if right is None else load_colour(right)
    if right is not None and other is not None:
        check_file_size(right, other, left, colour)
    filled, known = fill_unknown(stored_px)
    if right is None and (wide := too_wide(filled)) is not None:
        raise InputError(f"{disparity}: {wide}; is units_per_px (--units-per-px) right?")
    return StereoPair(
        left=colour,
        right=other,
        disparity_px=filled,
        known=known,
        focal_px=focal_px or ASSUMED_FIELD_OF_VIEW * colour.shape[1],
        baseline_m=baseline_m,
        offset_px=offset_px,
    )


def too_wide(disparity_px: NDArray[np.float32]) -> str | None:
    """Say that a disparity leads farther than the picture is wide; None where none does."""
    width = disparity_px.shape[1]
    wide = np.abs(disparity_px) >= width
    if not wide.any():
        return None
    row, column = np.argwhere(wide)[0]
    return (
        f"a disparity must be less than the picture's width, {width} px (got"
        f" {disparity_px[row, column]:g} px at row {row}, column {column}, and"
        f" {int(wide.sum()) - 1} more such pixels)"
    )


def _from_bytes(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    return (image[..., :3].astype(np.float64) / 255).astype(np.float32)
