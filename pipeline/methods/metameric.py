"""`metameric`, `metameric-paper` and `push-pull-depth`: fills that depth guides."""

from abc import ABC, abstractmethod
from typing import Generic, Protocol, TypeVar

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame, check_some_known
from pipeline.gl.texture import create_texture, read_back, upload
from pipeline.inpaint.gpu import GuidedBasePass
from pipeline.inpaint.reference import nearest_depth_m
from pipeline.methods.method import composite
from pipeline.printed.gpu import PrintedPass
from pipeline.printed.settings import PrintedSettings
from pipeline.synthesis.gpu import MetamericPass
from pipeline.synthesis.settings import Anchor, Channels, MetamericSettings, Texture

_FORMATS = ("rgba32f", "r32f", "rg32f")  # colour with validity, depth, motion


class _Pass(Protocol):
    def release(self) -> None: ...


P = TypeVar("P", bound=_Pass)


class _Guided(ABC, Generic[P]):
    """A pass over colour, depth and motion, kept for the last frame size."""

    def __init__(self, ctx: moderngl.Context, z_near_m: float) -> None:
        if not (np.isfinite(z_near_m) and z_near_m >= 0):
            raise InputError(
                "z_near_m must be a depth in metres, or 0 for each frame's own nearest"
                f" (got {z_near_m})"
            )
        self._ctx = ctx
        self._z_near_m = z_near_m
        self._size: tuple[int, int] | None = None
        self._pass: P | None = None
        self._textures: list[moderngl.Texture] = []

    def fill(self, warped: WarpedFrame, seed: int) -> NDArray[np.float32]:
        """Fill the holes; known pixels are untouched."""
        check_some_known(warped.hole)
        known = (~warped.hole).astype(np.float32)[..., None]
        filler = self._prepared((warped.size[1], warped.size[0]))
        arrays = (
            np.concatenate([warped.colour * known, known], axis=-1),
            warped.depth_m,
            warped.flow_px,
        )
        for texture, array in zip(self._textures, arrays, strict=True):
            upload(texture, array)
        self._run(filler, self._z_near_m or nearest_depth_m(warped.depth_m), seed)
        return composite(warped, read_back(self._textures[0])[..., :3])

    def release(self) -> None:
        """Free textures and shaders."""
        if self._pass is not None:
            self._pass.release()
        for texture in self._textures:
            texture.release()
        self._pass, self._textures, self._size = None, [], None

    def _prepared(self, size: tuple[int, int]) -> P:
        if self._pass is None or self._size != size:
            self.release()
            self._pass = self._build(size)
            self._textures = [create_texture(self._ctx, size, name) for name in _FORMATS]
            self._size = size
        return self._pass

    @abstractmethod
    def _build(self, size: tuple[int, int]) -> P: ...

    @abstractmethod
    def _run(self, filler: P, z_near_m: float, seed: int) -> None: ...


class Metameric(_Guided[MetamericPass]):
    """Kuffner dos Anjos et al. 2022. Parameters: see `MetamericSettings`.

    `z_near_m` is the clip's nearest depth; 0 takes each frame's own, which makes the
    depth threshold vary from frame to frame.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        *,
        levels: int = MetamericSettings.levels,
        gamma: float = MetamericSettings.gamma,
        depth_threshold: float = MetamericSettings.depth_threshold,
        noise: float = MetamericSettings.noise,
        channels: Channels = MetamericSettings.channels,
        anchor: Anchor = MetamericSettings.anchor,
        skip_depth_edges: bool = MetamericSettings.skip_depth_edges,
        texture: Texture = MetamericSettings.texture,
        z_near_m: float = 0.0,
    ) -> None:
        super().__init__(ctx, z_near_m)
        if anchor == "camera":
            raise InputError(
                'anchor must be "flow" or "screen" in a study (got \'camera\', which needs the'
                " two cameras of each frame: use MetamericPass in Python)"
            )
        self._settings = MetamericSettings(
            levels=levels,
            gamma=gamma,
            depth_threshold=depth_threshold,
            noise=noise,
            channels=channels,
            anchor=anchor,
            skip_depth_edges=skip_depth_edges,
            texture=texture,
        )

    def _build(self, size: tuple[int, int]) -> MetamericPass:
        return MetamericPass(self._ctx, size, self._settings)

    def _run(self, filler: MetamericPass, z_near_m: float, seed: int) -> None:
        filler(*self._textures, z_near_m=z_near_m, seed=seed)


class PushPullDepth(_Guided[GuidedBasePass]):
    """Push-pull that keeps to the background: what depth alone buys.

    `gamma` and `depth_threshold` as for `metameric`'s base.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        *,
        gamma: float = MetamericSettings.gamma,
        depth_threshold: float = MetamericSettings.depth_threshold,
        z_near_m: float = 0.0,
    ) -> None:
        super().__init__(ctx, z_near_m)
        MetamericSettings(gamma=gamma, depth_threshold=depth_threshold)  # checks the ranges
        self._gamma = gamma
        self._depth_threshold = depth_threshold

    def _build(self, size: tuple[int, int]) -> GuidedBasePass:
        return GuidedBasePass(
            self._ctx, size, gamma=self._gamma, depth_threshold=self._depth_threshold
        )

    def _run(self, filler: GuidedBasePass, z_near_m: float, seed: int) -> None:  # noqa: ARG002
        image, depth_m, _ = self._textures
        filler(image, depth_m, z_near_m)


class MetamericPaper(_Guided[PrintedPass]):
    """Kuffner dos Anjos et al. 2022 as printed. Parameters: see `PrintedSettings`.

    `z_near_m` as for `metameric`.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        *,
        levels: int = PrintedSettings.levels,
        gamma: float = PrintedSettings.gamma,
        depth_threshold: float = PrintedSettings.depth_threshold,
        z_near_m: float = 0.0,
    ) -> None:
        super().__init__(ctx, z_near_m)
        self._settings = PrintedSettings(levels, gamma, depth_threshold)

    def _build(self, size: tuple[int, int]) -> PrintedPass:
        return PrintedPass(self._ctx, size, self._settings)

    def _run(self, filler: PrintedPass, z_near_m: float, seed: int) -> None:
        filler(*self._textures, z_near_m=z_near_m, seed=seed)
