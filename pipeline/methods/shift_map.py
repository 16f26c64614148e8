"""`shift-map`: detail of the known background, shifted into the hole tile by tile."""

import moderngl

from pipeline.frame_textures import FrameTextures
from pipeline.methods.on_gpu import Guided
from pipeline.shiftmap.gpu import ShiftMapPass
from pipeline.shiftmap.plate_gpu import PlatePass, PlateTextures
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
        self._plates: PlatePass | None = None

    def new_plate(self) -> PlateTextures:
        """Return what keeps the fills of one source frame from view to view."""
        self._plates = self._plates or PlatePass(self._ctx, self._settings.depth_threshold)
        return self._plates.new_plate()

    def release(self) -> None:
        """Free textures and shaders; plates are their users'."""
        super().release()
        if self._plates is not None:
            self._plates.release()
        self._plates = None

    def _build(self, size: tuple[int, int]) -> ShiftMapPass:
        return ShiftMapPass(self._ctx, size, self._settings)

    def _run(self, filler: ShiftMapPass, frame: FrameTextures, seed: int) -> None:  # noqa: ARG002
        filler(frame, z_near_m=self._nearest_m(frame))
