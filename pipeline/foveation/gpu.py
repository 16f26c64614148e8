"""Foveated pictures on the GPU. Twin: reference.py.

A pull makes the chain of halvings and the moments of its bands, one pass a resolution; a push
chooses each texel's level of detail, one pass a resolution; between them gains are found for blocks
of 4x4 pixels. With K halvings 2 K + 1 passes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.foveation.chain import chain_length
from pipeline.foveation.chain_gpu import MomentChainPass, given
from pipeline.foveation.geometry import Geometry
from pipeline.foveation.noise_plane import carried_noise, tile_edge
from pipeline.foveation.picture_fixation import Colour, PictureFixation
from pipeline.foveation.picture_pass import (
    PicturePass,
    PoolUniforms,
    gains_constants,
    halved,
    layered,
    noise_constants,
    screen_noise,
    weight_layers,
)
from pipeline.foveation.pooling import FADE_SHARE, MetamerSettings, Pooling
from pipeline.frame import check_seed
from pipeline.gl.compute import Shader, let_go
from pipeline.gl.texture import check_texture, create_texture, texture_from, upload
from pipeline.noise.gains import LAGS, fitted_mixing
from pipeline.noise.gpu import NoisePass
from pipeline.noise.tile import TEXELS_PER_PX

OPAQUE = {"rgba8": 255, "rgba32f": 1}


@dataclass(frozen=True)
class Call:
    """Arguments of a call of a pass: see `FoveationPass.show`."""

    gaze_px: tuple[float, float]
    seed: int
    noise_shift_px: moderngl.Texture | None
    field_gaze_px: tuple[float, float]


@dataclass(eq=False)
class CarriedNoise:
    """Noise that surfaces carry along, and the last pass that reads it."""

    finish: Shader
    texture: moderngl.TextureArray
    seed: int = -1


class FoveationPass(PicturePass):
    """A condition on the GPU, for pictures of one size.

    Compiles and allocates on construction (and once more for the first seed, and the first carried
    noise). `hold` and `show` bind and dispatch, and read nothing back.

    Attributes
    ----------
    carries_noise : bool
        Whether a call takes `noise_shift_px`.
    """

    carries_noise: ClassVar[bool] = True

    def __init__(self, ctx: moderngl.Context, geometry: Geometry, pooling: Pooling) -> None:
        self._eye = PoolUniforms(geometry, pooling)
        size = geometry.width_px, geometry.height_px
        super().__init__(ctx, size, self._eye, wraps=geometry.wraps)
        self.geometry = geometry
        self._source: moderngl.Texture | None = None
        self._chosen: Call | None = None  # of the picture that is held
        self._ends: dict[str, moderngl.Texture] = {}  # for callers without textures
        self._reader: moderngl.Framebuffer | None = None  # of what is shown to them
        self.chains: list[MomentChainPass] = []  # what analyses pictures

    def _analysis(self, levels: int, deepest: int, *, chroma: bool = True) -> MomentChainPass:
        # Moments of resolution 2 are chosen where they are read, in gains.comp.glsl.
        chain = MomentChainPass(self._ctx, self._eye, levels, deepest, chroma=chroma, finest=3)
        self._part(chain)
        self.chains.append(chain)
        return chain

    def _analyse(self, source: moderngl.Texture) -> None:
        """Do what depends on the picture alone."""
        raise NotImplementedError

    def _choose(self, source: moderngl.Texture, call: Call) -> None:
        """Do what a call asks for, up to the last pass; pools are known, and textures checked."""
        raise NotImplementedError

    def _finish(self, source: moderngl.Texture, target: moderngl.Texture, call: Call) -> None:
        """Run the last pass."""
        raise NotImplementedError

    def _spare(self) -> None:
        """Free what the last pass does not read."""
        raise NotImplementedError

    def set_seed(self, seed: int, *, carried: bool = False) -> None:
        """Make what a seed decides, where there is such, unless it is at hand."""

    def hold(self, source: moderngl.Texture) -> None:
        """Analyse a picture, rgba32f or rgba8, which stays the caller's and must not change."""
        check_texture(source, "source", self.size, "rgba32f", "rgba8")
        self._analyse(source)
        self._source, self._chosen = source, None

    def show(
        self,
        target: moderngl.Texture,
        gaze_px: tuple[float, float],
        *,
        seed: int = 0,
        noise_shift_px: moderngl.Texture | None = None,
        field_gaze_px: tuple[float, float] | None = None,
    ) -> None:
        """Show the picture that is held to an eye at `gaze_px`, into `target`: rgba32f.

        Alpha is copied. `noise_shift_px` (rg32f) and `field_gaze_px`: see `foveate`.
        """
        check_texture(target, "target", self.size, "rgba32f")
        if noise_shift_px is not None:
            check_texture(noise_shift_px, "noise_shift_px", self.size, "rg32f")
        call = Call(gaze_px, seed, noise_shift_px, field_gaze_px or gaze_px)
        self._finish(self._look(call), target, call)

    def _look(self, call: Call) -> moderngl.Texture:
        """Do all but the last pass, and return the picture that is held."""
        if self._source is None:
            raise ValueError("hold a picture before you show it")
        if call.noise_shift_px is not None and not self.carries_noise:
            raise ValueError("these passes cannot carry noise along; numpy can")
        self._eye.set_gaze(call.gaze_px)
        if call != self._chosen or call.noise_shift_px is not None:
            self._choose(self._source, call)
            self._chosen = call
        return self._source

    def __call__(
        self,
        source: moderngl.Texture,
        target: moderngl.Texture,
        gaze_px: tuple[float, float],
        **fixation: Any,
    ) -> None:
        """Hold `source`, and show it; see there."""
        self.hold(source)
        self.show(target, gaze_px, **fixation)

    def upload(self, picture: Colour | NDArray[np.uint8]) -> None:
        """Hold a picture (H, W, 3) without a texture of the caller's."""
        name = "rgba8" if picture.dtype == np.uint8 else "rgba32f"
        source = self._ends.get(name)
        if source is None:
            source = self._ends[name] = create_texture(self._ctx, self.size, name)
        upload(source, np.pad(picture, ((0, 0), (0, 0), (0, 1)), constant_values=OPAQUE[name]))
        self.hold(source)

    def shown(self, fixation: PictureFixation, *, last: bool = False) -> Colour:
        """Show what is held, and read it back; the `last` time, all is freed as soon as it can."""
        self.set_seed(fixation.seed, carried=fixation.noise_shift_px is not None)
        shift = None
        if fixation.noise_shift_px is not None:
            shift = texture_from(self._ctx, fixation.noise_shift_px.astype(np.float32), "rg32f")
        call = Call(
            fixation.gaze_px, fixation.seed, shift, fixation.field_gaze_px or fixation.gaze_px
        )
        source = self._look(call)
        if last:
            self._spare()
        target = self._ends.get("target")
        if target is None:
            target = self._ends["target"] = create_texture(self._ctx, self.size, "rgba32f")
        self._finish(source, target, call)
        if shift is not None:
            shift.release()
        if last:
            reader, self._reader = self._reader, None
            del self._ends["target"]
            self.release()
            let_go(self._ctx)
            self._reader = reader
        if self._reader is None:
            self._reader = self._ctx.framebuffer([target])  # reads three of the four channels
        found = np.empty((self.size[1], self.size[0], 3), np.float32)
        self._reader.read_into(found, components=3, dtype="f4", alignment=1)
        if last:
            target.release()
            self._release_reader()
            let_go(self._ctx)
        return found

    def apply(self, picture: Colour, fixation: PictureFixation) -> Colour:
        """Upload, work, read back: for callers without textures."""
        self.upload(picture)
        return self.shown(fixation)

    def _release_reader(self) -> None:
        if self._reader is not None:
            self._reader.release()
            self._reader = None

    def release(self) -> None:
        for end in self._ends.values():
            end.release()
        self._ends.clear()
        self._release_reader()
        self._source = None
        super().release()


class BlurPass(FoveationPass):
    """The blur of a pooling law."""

    def __init__(self, ctx: moderngl.Context, geometry: Geometry, pooling: Pooling) -> None:
        super().__init__(ctx, geometry, pooling)
        self._chain = self._analysis(0, chain_length(*self.size))
        self._last = self._compile("finish", FADE_SHARE=FADE_SHARE)
        self._last.hold(coarse=self._chain.chosen.lows[0])

    def _analyse(self, source: moderngl.Texture) -> None:
        self._chain.pull(source)

    def _choose(self, source: moderngl.Texture, call: Call) -> None:  # noqa: ARG002
        self._chain.push(1)

    def _spare(self) -> None:
        self._chain.release_but(self._chain.chosen.lows[:1])

    def _finish(self, source: moderngl.Texture, target: moderngl.Texture, call: Call) -> None:  # noqa: ARG002
        self._play(self._add, source, target)

    def _add(self, source: moderngl.Texture, target: moderngl.Texture) -> None:
        self._last.run_over(self.size, source=source, target=target)


class MetamerPass(FoveationPass):
    """Noise with each pool's moments; chroma ``follow`` or ``luma``.

    Raises
    ------
    InputError, GLUnavailableError
        If the driver cannot hold pictures of this size.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        geometry: Geometry,
        settings: MetamerSettings,
        *,
        seed: int | None = None,
    ) -> None:
        super().__init__(ctx, geometry, settings.pooling)
        self.settings = settings
        count = chain_length(*self.size)
        self.levels = levels = min(settings.levels, count)
        self._screen: NoisePass | None = None
        self._carried: CarriedNoise | None = None
        if seed is not None:
            self.set_seed(seed)
        self._chroma = settings.chroma != "luma"
        deepest = levels if settings.residual == "kept" else count
        self._chain = self._analysis(levels, deepest, chroma=self._chroma)
        layers = weight_layers(levels, bent=self._chroma)
        self._weights = self._array(self._chain.sizes[2], layers, "rgba16f")
        constants = gains_constants(levels, chroma=self._chroma, count=count)
        self._gains = self._compile("gains", **constants)
        self._on_screen = self._compile_finish(carried=False)

    def _analyse(self, source: moderngl.Texture) -> None:
        self._chain.pull(source)

    def _choose(self, source: moderngl.Texture, call: Call) -> None:  # noqa: ARG002
        self.set_seed(call.seed, carried=call.noise_shift_px is not None)
        self._play(self._weigh)

    def _spare(self) -> None:
        self._chain.release_but(self._chain.chosen.lows[:1])

    def _finish(self, source: moderngl.Texture, target: moderngl.Texture, call: Call) -> None:
        self._play(self._add, source, target, call.noise_shift_px)

    def _weigh(self) -> None:
        # Moments of resolutions 1 and 2 as they were pulled, of the others as they were chosen.
        chain = self._chain
        chain.push(2)
        last = min(max(3, self.levels), chain.count)
        moments, powers = chain.chosen.moments[:last], chain.chosen.powers[1:3]
        self._gains.run_over(
            halved(chain.sizes[2]),
            weights=self._weights,
            moments=[one for one in moments if one],
            powers=[one for one in powers if one],
        )
        chain.push(1, 1)

    def _add(
        self,
        source: moderngl.Texture,
        target: moderngl.Texture,
        shift_px: moderngl.Texture | None,
    ) -> None:
        lies = self._screen if shift_px is None else self._carried
        assert lies is not None
        (self._on_screen if isinstance(lies, NoisePass) else lies.finish).run_over(
            halved(self.size),
            source=source,
            coarse=self._chain.chosen.lows[0],
            weights=self._weights,
            noise=lies.texture,
            target=target,
            **given(shift_px=shift_px),
        )

    def set_seed(self, seed: int, *, carried: bool = False) -> None:
        """Make the noise of `seed`, unless it is at hand."""
        seed = check_seed(seed)
        if carried:
            self._carry(seed)
            return
        if self._screen is None:
            wraps = self.geometry.wraps
            self._screen = self._part(screen_noise(self._ctx, self.size, self.levels, wraps=wraps))
        self._screen.set_seed(seed)

    def _carry(self, seed: int) -> None:
        if self._carried is not None and self._carried.seed == seed:
            return
        # A texel is a place with up to sixteen bands: (layers, edge * 2, edge * 2, 16).
        tiles = carried_noise(seed, self.levels, 1, tile_edge(*self.size)).tiles[:, 0]
        levels, edge = tiles.shape[:2]
        tile = layered(tiles.transpose(1, 2, 0, 3).reshape(edge, edge, 3 * levels))
        if self._carried is None:
            layers, height, width, _ = tile.shape
            texture = self._array((width, height), layers, "rgba32ui")
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
            finish = self._compile_finish(carried=True)
            lags = fitted_mixing(self.levels).lag_correlation
            finish["lag_correlation"] = lags.reshape(-1, len(LAGS))
            self._carried = CarriedNoise(finish, texture)
        self._carried.texture.write(tile.tobytes())
        self._carried.seed = seed

    def _compile_finish(self, *, carried: bool) -> Shader:
        constants = noise_constants(self.levels, BENT=self._chroma)
        if carried:
            constants["TEXELS_PER_PX"] = TEXELS_PER_PX
        shader = self._compile("finish_carried" if carried else "finish_screen", **constants)
        shader["strength"] = self.settings.noise
        return shader
