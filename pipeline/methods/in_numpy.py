"""Methods that draw on the GPU, where there is none: by their numpy twins."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pipeline.frame import WarpedFrame, check_some_known
from pipeline.methods.method import CleanPlate, composite


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
