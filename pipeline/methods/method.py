"""The one signature of all fill methods, and what each of them must keep.

Methods that draw on the GPU are drawn by their numpy twins where there is none.
"""

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame, check_some_known
from pipeline.frame_textures import FrameTextures


class Method(Protocol):
    """A configured way to fill the holes of a warped frame.

    A fill is a pure function of the frame and the seed: any state is only a cache, so
    frame k alone equals frame k within a sequence.
    """

    def fill(self, warped: WarpedFrame, seed: int) -> NDArray[np.float32]:
        """Return the frame without holes.

        Parameters
        ----------
        warped : WarpedFrame
            At least one pixel must be known.
        seed : int
            Of the noise, from 0 to 2**63 - 1; methods without noise ignore it.

        Returns
        -------
        ndarray of float32, shape (H, W, 3)
            Encoded R'G'B' in [0, 1]; bit for bit `warped.colour` outside the holes.

        Raises
        ------
        InputError
            If every pixel is a hole, or the method cannot take a frame of this size.
        """
        ...

    def release(self) -> None:
        """Free what the method holds on the GPU; nothing for methods that hold nothing."""
        ...


@runtime_checkable
class CleanPlate(Protocol):
    """Memory of a method for one source frame, from view to view of a path."""

    def fill(self, warped: WarpedFrame, seed: int) -> NDArray[np.float32]:
        """Fill the next view as `Method.fill`, (H, W, 3), with what earlier views got in holes."""
        ...


@runtime_checkable
class TexturePlate(Protocol):
    """A plate on the GPU."""

    def fill_textures(self, frame: FrameTextures, seed: int) -> None:
        """Fill the next view in place, as `CleanPlate.fill` does arrays."""
        ...

    def release(self) -> None:
        """Free the plate."""
        ...


@runtime_checkable
class PlateMethod(Method, Protocol):
    """A method with a plate, which fills the views of one source frame.

    Views come in the order of their path, so a frame is a pure function of source, path and
    seed. `fill` alone gives what the first view of a path gets, with the same parameters; some have
    another default in clips.
    """

    def new_plate(self) -> CleanPlate | TexturePlate:
        """Return an empty plate, for the views of one source frame."""
        ...


def composite(warped: WarpedFrame, filled: NDArray[np.floating]) -> NDArray[np.float32]:
    """Put `filled`, clipped to [0, 1], into the holes of `warped` and copy all else bit for bit.

    Raises
    ------
    InputError
        If `filled` has another shape than the frame, (H, W, 3), or is not finite inside a hole.
    """
    if filled.shape != warped.colour.shape:
        raise InputError(
            f"the fill must have shape {warped.colour.shape} as the frame (got {filled.shape})"
        )
    result = warped.colour.copy()
    inside = filled[warped.hole]
    check_finite(inside)
    result[warped.hole] = inside.clip(0.0, 1.0)
    return result


def check_finite(inside: NDArray[np.floating]) -> None:
    """Require finite colours in the holes.

    Raises
    ------
    InputError
        If some are not.
    """
    if not np.isfinite(inside).all():
        raise InputError(
            f"the fill must be finite in every hole (got {int((~np.isfinite(inside)).sum())}"
            " values that are NaN or infinite)"
        )


class InNumpy:
    """A configured method that works by its twin.

    Parameters
    ----------
    fill : function of a frame with holes and a seed
        Returns the colour of the whole frame, (H, W, 3).
    new_plate : function, optional
        Of a method with a plate.
    """

    def __init__(
        self,
        fill: Callable[[WarpedFrame, int], NDArray[np.floating]],
        new_plate: Callable[[], CleanPlate] | None = None,
    ) -> None:
        self._fill = fill
        if new_plate is not None:
            self.new_plate = new_plate  # what tells a `PlateMethod`

    def fill(self, warped: WarpedFrame, seed: int) -> NDArray[np.float32]:
        """Fill the holes; known pixels are untouched."""
        check_some_known(warped.hole)
        return composite(warped, self._fill(warped, seed))

    def release(self) -> None:
        """Free what the method holds on the GPU: nothing."""
