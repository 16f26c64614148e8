"""`coherence-transport`: edges of the background go on in its holes."""

import numpy as np

from pipeline.frame import Floats, WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.methods.method import InNumpy
from pipeline.methods.on_gpu import DepthGuidedMethod
from pipeline.plate.gpu import PlatePass, PlateTextures
from pipeline.plate.reference import KeptFills
from pipeline.transport.gpu import TransportPass
from pipeline.transport.reference import transport_fill
from pipeline.transport.settings import TransportSettings


class CoherenceTransport(DepthGuidedMethod[TransportPass]):
    """After Bornemann and März 2007, guided by depth. Parameters: see `TransportSettings`.

    It takes no chance: no seed. `z_near_m` as for `metameric`.
    """

    settings_class = TransportSettings
    _settings: TransportSettings

    def new_plate(self) -> PlateTextures:
        """Return the plate that keeps the fills of one source frame from view to view."""
        return self._new_plate()

    def in_numpy(self) -> InNumpy:
        """Return the numpy twin of this method with its parameters."""
        return InNumpy(
            lambda warped, _seed: self._filled(warped),
            lambda: KeptFills(
                lambda known, _weight: self._filled(known).astype(np.float32),
                self._settings.depth_threshold,
            ),
        )

    def _filled(self, warped: WarpedFrame) -> Floats:
        nearest_m = self._nearest_m(warped)
        return transport_fill(warped, self._settings, z_near_m=nearest_m).colour

    def _build(self, size: tuple[int, int]) -> TransportPass:
        return TransportPass(self._ctx, size, self._settings)

    def _build_plate(self, size: tuple[int, int]) -> PlatePass:
        return PlatePass(self._ctx, size, self._settings.depth_threshold)

    def _run(self, filler: TransportPass, frame: FrameTextures, seed: int) -> None:  # noqa: ARG002
        filler(frame, z_near_m=self._nearest_m(frame))
