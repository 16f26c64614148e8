"""`shift-map`: detail of the known background, shifted into the hole tile by tile."""

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame, check_some_known
from pipeline.inpaint.reference import nearest_depth_m
from pipeline.methods.method import composite
from pipeline.shiftmap.plate import ShiftMapPlate
from pipeline.shiftmap.reference import shift_map_fill
from pipeline.shiftmap.settings import ShiftMapSettings


class ShiftMap:
    """After Pritch et al. 2009. Parameters: see `ShiftMapSettings`. Runs on the CPU.

    `z_near_m` as for `metameric`.
    """

    def __init__(
        self,
        *,
        gain: float = ShiftMapSettings.gain,
        depth_threshold: float = ShiftMapSettings.depth_threshold,
        z_near_m: float = 0.0,
    ) -> None:
        if not (np.isfinite(z_near_m) and z_near_m >= 0):
            raise InputError(
                "z_near_m must be a depth in metres, or 0 for each frame's own nearest"
                f" (got {z_near_m})"
            )
        self._settings = ShiftMapSettings(gain, depth_threshold)
        self._z_near_m = z_near_m

    def fill(self, warped: WarpedFrame, seed: int) -> NDArray[np.float32]:
        """Fill the holes; known pixels are untouched."""
        check_some_known(warped.hole)
        z_near_m = self._z_near_m or nearest_depth_m(warped.depth_m)
        return composite(
            warped, shift_map_fill(warped, self._settings, seed=seed, z_near_m=z_near_m).colour
        )

    def new_plate(self) -> ShiftMapPlate:
        """Return what keeps the fills of one source frame from view to view."""
        return ShiftMapPlate(self._settings.depth_threshold)

    def release(self) -> None:
        """Hold nothing."""
