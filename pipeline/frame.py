"""The typed arrays that flow through the pipeline, checked once at the border.

Arrays are (row, column[, channel]), x to the right and y down. The centre of the pixel in
row i and column j lies at x = j + 0.5, y = i + 0.5.
"""

import operator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, SupportsIndex, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]
Bools: TypeAlias = NDArray[np.bool_]
AnyArray: TypeAlias = NDArray[Any]
"""Array of any kind of number, as files hold them."""


@dataclass(frozen=True, eq=False)  # arrays have no single truth value
class SourceFrame:
    """View of a renderer or camera: colour and depth (RGBZ).

    Parameters
    ----------
    colour : ndarray of float32, shape (H, W, 3)
        Encoded R'G'B' in [0, 1].
    depth_m : ndarray of float32, shape (H, W)
        Distance along the optical axis, > 0; larger is farther; inf is "nothing there".
    measured : ndarray of bool, shape (H, W), optional
        False where depth was unknown and set by what is beside it. None: nowhere.

    Raises
    ------
    InputError
        Naming the array, what must hold, what was found and where.
    """

    colour: NDArray[np.float32]
    depth_m: NDArray[np.float32]
    measured: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        check_colour(self.colour, "colour")
        check_depth(self.depth_m, "depth_m")
        check_same_size(colour=self.colour, depth_m=self.depth_m)
        if self.measured is not None:
            check_hole(self.measured, "measured")
            check_same_size(depth_m=self.depth_m, measured=self.measured)

    @property
    def size(self) -> tuple[int, int]:
        """(height, width), pixels."""
        return self.depth_m.shape[0], self.depth_m.shape[1]


@dataclass(frozen=True, eq=False)  # arrays have no single truth value
class PanoramaFrame:
    """Colour and distance of all that is around a place, equirectangular.

    Parameters
    ----------
    colour : ndarray of float32, shape (H, 2 H, 3)
        Encoded R'G'B' in [0, 1].
    distance_m : ndarray of float32, shape (H, 2 H)
        Along each pixel's own ray, > 0; inf is "nothing there".
    measured : ndarray of bool, shape (H, 2 H), optional
        As `SourceFrame` has it.

    Raises
    ------
    InputError
        As `SourceFrame`, or if the panorama is not 2:1.
    """

    colour: NDArray[np.float32]
    distance_m: NDArray[np.float32]
    measured: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        height, width = SourceFrame(self.colour, self.distance_m, self.measured).size
        if width != 2 * height:
            raise InputError(
                f"a panorama must be twice as wide as high (got {width} x {height} px)"
            )


@dataclass(frozen=True)
class TargetWindow:
    """The target view, in the source's pixel grid.

    A source rendered with a margin is larger than the window that is shown.

    Parameters
    ----------
    x_px, y_px : int
        Where the window's left top corner lies in the source; may be negative.
    width_px, height_px : int
        Its size.

    Raises
    ------
    InputError
        If it holds no pixel.
    """

    x_px: int
    y_px: int
    width_px: int
    height_px: int

    def __post_init__(self) -> None:
        if self.width_px < 1 or self.height_px < 1:
            raise InputError(
                f"a window must hold at least 1x1 px (got {self.width_px}x{self.height_px})"
            )

    @classmethod
    def of(cls, source_size: tuple[int, int]) -> "TargetWindow":
        """All of a source of `source_size` (height, width)."""
        return cls(0, 0, source_size[1], source_size[0])

    @classmethod
    def inside_margin(cls, source_size: tuple[int, int], margin_px: int) -> "TargetWindow":
        """A source of `source_size` (height, width) without `margin_px` on every side."""
        height, width = source_size
        return cls(margin_px, margin_px, width - 2 * margin_px, height - 2 * margin_px)


@dataclass(frozen=True, eq=False)  # arrays have no single truth value
class WarpedFrame:
    """A source frame as another view sees it, with holes: what every fill method takes.

    Parameters
    ----------
    colour : ndarray of float32, shape (H, W, 3)
        Encoded R'G'B' in [0, 1]; meaningless, but finite, inside holes.
    depth_m : ndarray of float32, shape (H, W)
        Depth, and inside holes the background's depth; > 0, inf allowed.
    hole : ndarray of bool, shape (H, W)
        True where the target pixel shows nothing that the source saw.
    flow_px : ndarray of float32, shape (H, W, 2)
        Warped motion: target minus source position of what each pixel shows, x then y.
        Inside holes the motion of the background.
    frame_index : int
        Which frame of its clip this is, from 0.

    Raises
    ------
    InputError
        Naming the array, what must hold, what was found and where.
    """

    colour: NDArray[np.float32]
    depth_m: NDArray[np.float32]
    hole: NDArray[np.bool_]
    flow_px: NDArray[np.float32]
    frame_index: int = 0

    def __post_init__(self) -> None:
        if self.frame_index < 0:
            raise InputError(f"frame_index must be at least 0 (got {self.frame_index})")
        check_colour(self.colour, "colour")
        check_depth(self.depth_m, "depth_m")
        check_hole(self.hole, "hole")
        check_flow(self.flow_px, "flow_px")
        check_same_size(
            colour=self.colour, depth_m=self.depth_m, hole=self.hole, flow_px=self.flow_px
        )

    @property
    def size(self) -> tuple[int, int]:
        """(height, width), pixels."""
        return self.hole.shape[0], self.hole.shape[1]


def check_colour(array: AnyArray, name: str) -> None:
    """Require encoded colour: float32 (H, W, 3), finite, in [0, 1]."""
    _check_array(array, name, np.float32, (None, None, 3))
    _check_every((array >= 0) & (array <= 1), array, name, "finite and in [0, 1]")  # no NaN is


NO_DEPTH = "; store inf there if there is nothing, else render or measure its depth again"


def check_depth(array: AnyArray, name: str, *, cure: str = "") -> None:
    """Require depth: float32 (H, W), greater than 0, inf allowed; `cure` ends the message."""
    _check_array(array, name, np.float32, (None, None))
    _check_every(array > 0, array, name, "greater than 0 (inf where there is nothing)", cure)


def check_flow(array: AnyArray, name: str) -> None:
    """Require motion: float32 (H, W, 2), finite."""
    _check_array(array, name, np.float32, (None, None, 2))
    _check_every(np.isfinite(array), array, name, "finite")


def check_hole(array: AnyArray, name: str) -> None:
    """Require a mask: bool (H, W)."""
    _check_array(array, name, np.bool_, (None, None))


def check_same_size(**arrays: AnyArray) -> None:
    """Require one height and width for all of `arrays`, named by their keywords."""
    sizes = {name: array.shape[:2] for name, array in arrays.items()}
    if len(set(sizes.values())) > 1:
        found = ", ".join(f"{name} {height}x{width}" for name, (height, width) in sizes.items())
        raise InputError(f"all arrays must have one height and width (got {found})")


def check_file_size(
    path: Path | str, array: AnyArray, picture: Path | str, colour: AnyArray
) -> None:
    """Require that a file of numbers is as large as its picture."""
    (height, width), (rows, columns) = array.shape[:2], colour.shape[:2]
    if (height, width) != (rows, columns):
        raise InputError(
            f"{path}: must be as large as {picture}, {columns} x {rows} px (is {width} x {height}"
            f" px); make it of that picture, or scale the picture to {width} x {height} px"
        )


def check_some_known(hole: NDArray[np.bool_]) -> None:
    """Require at least one pixel outside the holes: from nothing, nothing can be filled."""
    if hole.all():
        raise InputError(
            f"hole must leave at least one known pixel (all {hole.size} pixels are holes);"
            " after a warp, check that the flow does not take everything out of view"
        )


def _check_array(
    array: AnyArray, name: str, dtype: type[np.generic], shape: tuple[int | None, ...]
) -> None:
    if not isinstance(array, np.ndarray):
        raise InputError(f"{name} must be a numpy array (got {type(array).__name__})")
    wanted = "(" + ", ".join({0: "H", 1: "W"}.get(i, str(n)) for i, n in enumerate(shape)) + ")"
    fits = array.ndim == len(shape) and all(
        n is None or n == found for n, found in zip(shape, array.shape, strict=False)
    )
    if not fits or array.dtype != dtype:
        raise InputError(
            f"{name} must be {np.dtype(dtype).name} of shape {wanted}"
            f" (got {array.dtype} of shape {array.shape})"
        )
    if array.size == 0:
        raise InputError(f"{name} must hold at least one pixel (got shape {array.shape})")


def _check_every(
    good: NDArray[np.bool_], array: AnyArray, name: str, rule: str, cure: str = ""
) -> None:
    if not good.all():  # by pixel only then: that takes a hundred times as long
        bad = ~good.reshape(*array.shape[:2], -1).all(axis=-1)
        row, column = np.argwhere(bad)[0]
        others = int(bad.sum()) - 1
        more = f", and {others} more such pixels" if others else ""
        raise InputError(
            f"{name} must be {rule} (got {array[row, column]} at row {row}, column {column}{more})"
            + cure
        )


def check_seed(seed: SupportsIndex) -> int:
    """Return `seed` as an int.

    Raises
    ------
    InputError
        If it is not a whole number from 0 to 2**63 - 1.
    """
    try:
        value = operator.index(seed)
    except TypeError:
        value = -1
    if isinstance(seed, bool) or not 0 <= value < 1 << 63:
        raise InputError(f"seed must be a whole number from 0 to 2**63 - 1 (got {seed!r})")
    return value
