"""Fills that depth guides: `metameric`, `metameric-paper`, `push-pull-depth` and transport."""

from functools import partial

import moderngl
import numpy as np

from pipeline.frame import Floats, WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.inpaint.gpu import GuidedBasePass
from pipeline.inpaint.reference import guide_from_depth, guided_base
from pipeline.methods.method import InNumpy
from pipeline.methods.on_gpu import DepthGuidedMethod
from pipeline.plate.gpu import PlatePass, PlateTextures
from pipeline.plate.reference import KeptFills
from pipeline.printed.gpu import PrintedPass
from pipeline.printed.reference import PrintedSettings, printed_fill
from pipeline.synthesis.gpu import MetamericPass
from pipeline.synthesis.reference import metameric_fill
from pipeline.synthesis.settings import MetamericSettings
from pipeline.transport.gpu import TransportPass
from pipeline.transport.reference import TransportSettings, transport_fill


class Metameric(DepthGuidedMethod[MetamericPass]):
    """Kuffner dos Anjos et al. 2022. Parameters: see `MetamericSettings`.

    `z_near_m` is the clip's nearest depth; 0 takes each frame's own, which makes the
    depth threshold vary from frame to frame.
    """

    settings_class = MetamericSettings
    _settings: MetamericSettings

    def in_numpy(self) -> InNumpy:
        """Return the numpy twin of this method with its parameters."""
        return InNumpy(
            lambda warped, seed: (
                metameric_fill(
                    warped, self._settings, seed=seed, z_near_m=self._nearest_m(warped)
                ).colour
            )
        )

    def _build(self, size: tuple[int, int]) -> MetamericPass:
        return MetamericPass(self._ctx, size, self._settings)

    def _run(self, filler: MetamericPass, frame: FrameTextures, seed: int) -> None:
        filler(frame, z_near_m=self._nearest_m(frame), seed=seed)


class PushPullDepth(DepthGuidedMethod[GuidedBasePass]):
    """Push-pull that keeps to the background: what depth alone buys.

    `gamma` and `depth_threshold` as for `metameric`'s base.
    """

    settings_class = MetamericSettings
    _settings: MetamericSettings

    def __init__(
        self,
        ctx: moderngl.Context,
        *,
        gamma: float = MetamericSettings.gamma,
        depth_threshold: float = MetamericSettings.depth_threshold,
        z_near_m: float = 0.0,
    ) -> None:
        super().__init__(ctx, z_near_m=z_near_m, gamma=gamma, depth_threshold=depth_threshold)

    def in_numpy(self) -> InNumpy:
        """Return the numpy twin of this method with its parameters."""
        return InNumpy(self._filled)

    def _filled(self, warped: WarpedFrame, seed: int) -> Floats:  # noqa: ARG002
        guide = guide_from_depth(warped.depth_m, self._nearest_m(warped))
        return guided_base(
            warped.colour, warped.hole, guide,
            levels=1, gamma=self._settings.gamma, threshold=self._settings.depth_threshold,
        )[0].values  # fmt: skip

    def _build(self, size: tuple[int, int]) -> GuidedBasePass:
        return GuidedBasePass(
            self._ctx, size, gamma=self._settings.gamma,
            depth_threshold=self._settings.depth_threshold,
        )  # fmt: skip

    def _run(self, filler: GuidedBasePass, frame: FrameTextures, seed: int) -> None:  # noqa: ARG002
        filler(frame.colour, frame.depth_m, self._nearest_m(frame))


class MetamericPaper(DepthGuidedMethod[PrintedPass]):
    """Kuffner dos Anjos et al. 2022 as printed. Parameters: see `PrintedSettings`.

    `z_near_m` as for `metameric`.
    """

    settings_class = PrintedSettings
    _settings: PrintedSettings

    def in_numpy(self) -> InNumpy:
        """Return the numpy twin of this method with its parameters."""
        return InNumpy(
            lambda warped, seed: (
                printed_fill(
                    warped, self._settings, seed=seed, z_near_m=self._nearest_m(warped)
                ).colour
            )
        )

    def _build(self, size: tuple[int, int]) -> PrintedPass:
        return PrintedPass(self._ctx, size, self._settings)

    def _run(self, filler: PrintedPass, frame: FrameTextures, seed: int) -> None:
        filler(frame, z_near_m=self._nearest_m(frame), seed=seed)


class CoherenceTransport(DepthGuidedMethod[TransportPass]):
    """After Bornemann and März 2007, guided by depth. Parameters: see `TransportSettings`.

    The seed is of its detail alone. `z_near_m` as for `metameric`.
    """

    settings_class = TransportSettings
    _settings: TransportSettings
    _in_clips: "CoherenceTransport | None" = None  # what fills a clip's frames

    def new_plate(self) -> PlateTextures:
        """Return the plate that keeps the fills of one source frame from view to view."""
        if self._in_clips is None:
            settings = vars(self._settings.in_clips())
            self._in_clips = CoherenceTransport(self._ctx, z_near_m=self._z_near_m, **settings)
        return self._in_clips._new_plate()

    def release(self) -> None:
        """Free textures and shaders; plates are their users'."""
        super().release()
        if self._in_clips is not None:
            self._in_clips.release()

    def in_numpy(self) -> InNumpy:
        """Return the numpy twin of this method with its parameters."""
        return InNumpy(
            partial(self._filled, self._settings),
            lambda: KeptFills(
                lambda known, _weight, seed: self._filled(
                    self._settings.in_clips(), known, seed
                ).astype(np.float32),
                self._settings.depth_threshold,
            ),
        )

    def _filled(self, settings: TransportSettings, warped: WarpedFrame, seed: int) -> Floats:
        nearest_m = self._nearest_m(warped)
        return transport_fill(warped, settings, z_near_m=nearest_m, seed=seed).colour

    def _build(self, size: tuple[int, int]) -> TransportPass:
        return TransportPass(self._ctx, size, self._settings)

    def _build_plate(self, size: tuple[int, int]) -> PlatePass:
        return PlatePass(self._ctx, size, self._settings.depth_threshold)

    def _run(self, filler: TransportPass, frame: FrameTextures, seed: int) -> None:
        filler(frame, z_near_m=self._nearest_m(frame), seed=seed)
