"""`shift-map`: detail of the known background, shifted into the hole tile by tile."""

import moderngl

from pipeline.frame_textures import FrameTextures
from pipeline.methods.on_gpu import Guided
from pipeline.shiftmap.gpu import ShiftMapPass
from pipeline.shiftmap.plate import ShiftMapPlate
from pipeline.shiftmap.settings import ShiftMapSettings


class ShiftMap(Guided[ShiftMapPass]):
    """After Pritch et al. 2009. Parameters: see `ShiftMapSettings`. Takes no chance: no seed.

    `z_near_m` as for `metameric`.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        *,
        gain: float = ShiftMapSettings.gain,
        depth_threshold: float = ShiftMapSettings.depth_threshold,
        z_near_m: float = 0.0,
    ) -> None:
        super().__init__(ctx, z_near_m)
        self._settings = ShiftMapSettings(gain, depth_threshold)

    def new_plate(self) -> ShiftMapPlate:
        """Return what keeps the fills of one source frame from view to view."""
        return ShiftMapPlate(self._settings.depth_threshold)

    def _build(self, size: tuple[int, int]) -> ShiftMapPass:
        return ShiftMapPass(self._ctx, size, self._settings)

    def _run(self, filler: ShiftMapPass, frame: FrameTextures, seed: int) -> None:  # noqa: ARG002
        filler(frame, z_near_m=self._nearest_m(frame))
