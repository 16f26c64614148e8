"""Parts that passes over foveated pictures share: pools, sizes, noise that lies on the screen.

Cuts through a gaze that moves are here too (twin: `bisected` in drawn.py).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.foveation.drawn import cut_normal
from pipeline.foveation.geometry import (
    CapGeometry,
    EquirectangularGeometry,
    FlatGeometry,
    Geometry,
    check_gaze,
)
from pipeline.foveation.noise_plane import GRAIN, MOST_STEPS, panorama_margin, tile_edge
from pipeline.foveation.pooled_moments import (
    BOUND_CONSTANTS,
    LEAST_BOUND,
    LEAST_SKEWED,
    LEAST_TIGHTNESS,
    PARTNER_SHARE,
    SMALLEST_VARIANCE,
    STRONGEST_SKEW,
)
from pipeline.foveation.pooling import FADE_SHARE, HALVED_VARIANCE, Pooling
from pipeline.foveation.reference import AIM, COLOURED, FIRST_SMOOTH, ROOMY
from pipeline.foveation.sphere import BELT_DEG, CAP_DEG
from pipeline.frame import check_seed
from pipeline.gl.compute import Shader
from pipeline.gl.passes import Pass
from pipeline.gl.shader import Constant
from pipeline.gl.texture import check_texture, create_texture, read_back
from pipeline.noise.gains import gain_constants
from pipeline.noise.gpu import NoisePass

TILE = 8  # work-group edge
TEXEL_BYTES = 16  # of noise

_PROJECTIONS = {FlatGeometry: 0, EquirectangularGeometry: 1, CapGeometry: 2}  # see pools.glsl

Size = tuple[int, int]
S = TypeVar("S", Shader, moderngl.Program)


class PoolUniforms:
    """Uniforms of every shader with pools.glsl: the geometry and law once, the gaze per call."""

    def __init__(self, geometry: Geometry, pooling: Pooling) -> None:
        self.geometry = geometry
        self.constants = {
            "PROJECTION": _PROJECTIONS[type(geometry)],
            "POWER": pooling.power,
            "HALVED_VARIANCE": HALVED_VARIANCE,
        }
        self.fixed: dict[str, Any] = {
            "picture_px": (geometry.width_px, geometry.height_px),
            "slope": pooling.slope,
            "fovea_deg": pooling.fovea_deg,
        }
        if isinstance(geometry, FlatGeometry):
            self.fixed |= {"centre_px": geometry.centre_px, "distance_px": geometry.distance_px}
        elif isinstance(geometry, EquirectangularGeometry):
            self.fixed["least_cosine"] = geometry.least_cosine
        elif isinstance(geometry, CapGeometry):
            self.fixed |= {"radian_px": geometry.radian_px, "pole": geometry.pole}
        self._gazes: list[moderngl.Uniform] = []
        self._looks_at: tuple[float, float] | None = None
        self._ray: bytes | None = None

    def tell(self, shader: S) -> S:
        """Tell a shader what stays, and the gaze, now and from now on."""
        for name, value in self.fixed.items():
            if name in shader:
                shader[name] = value
        if "gaze" in shader:
            uniform: Any = shader.uniform("gaze") if isinstance(shader, Shader) else shader["gaze"]
            self._gazes.append(uniform)
            if self._ray is not None:
                self._gazes[-1].write(self._ray)
        return shader

    def set_gaze(self, gaze_px: tuple[float, float]) -> None:
        """Tell all shaders where the eye looks."""
        if gaze_px == self._looks_at:
            return
        self._ray = struct.pack("3f", *self.geometry.ray(*check_gaze(self.geometry, gaze_px)))
        for gaze in self._gazes:
            gaze.write(self._ray)
        self._looks_at = gaze_px


class PicturePass(Pass):
    """A pass over pictures of one size, whose textures are sampled linearly."""

    def __init__(
        self,
        ctx: moderngl.Context,
        size: Size,
        pooled: PoolUniforms,
        constants: Mapping[str, Constant] | None = None,
        *,
        wraps: bool = False,
    ) -> None:
        super().__init__(ctx, {"TILE": TILE, **pooled.constants, **(constants or {})})
        self.size = size
        self._pooled = pooled
        self._wraps = wraps

    def _compile(self, name: str, **constants: Constant) -> Shader:
        """Compile a shader of foveation that knows the pools."""
        return self._pooled.tell(self._shader(f"foveation/shaders/{name}.comp.glsl", **constants))

    def _texture(self, size: Size, format_name: str = "rgba32f") -> moderngl.Texture:
        """A texture that goes on as the picture does."""
        texture = super()._texture(size, format_name)
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = self._wraps
        return texture

    def _array(
        self, size: Size, layers: int, format_name: str = "rgba32f"
    ) -> moderngl.TextureArray:
        array = super()._array(size, layers, format_name)
        array.filter = (moderngl.LINEAR, moderngl.LINEAR)
        array.repeat_x = self._wraps
        return array


def sphere_constants() -> dict[str, float]:
    """Constants that sphere.glsl is compiled with."""
    return {
        name: math.sin(math.radians(angle))
        for name, angle in (("BELT_SINE", BELT_DEG), ("CAP_SINE", CAP_DEG))
    }


def noise_constants(levels: int, **changes: Constant) -> dict[str, Constant]:
    """Constants that shaders with weighed_noise.glsl are compiled with, and changes to them."""
    constants: dict[str, Constant] = {
        "FADE_SHARE": FADE_SHARE,
        "LEVELS": levels,
        "BASE": True,
        "BENT": False,
        "COLOURED": COLOURED,
        "ROOMY": ROOMY,
        "FIRST_SMOOTH": FIRST_SMOOTH,
        "NOISE_SCALE": GRAIN,
        **BOUND_CONSTANTS,
        **sphere_constants(),
    }
    return constants | changes


def gains_constants(levels: int, *, chroma: bool, count: int) -> dict[str, Constant]:
    """Constants of gains.comp.glsl, of a picture that is halved `count` times."""
    return {
        **gain_constants(levels, aim=AIM),
        "SMALLEST_VARIANCE": SMALLEST_VARIANCE,
        "PARTNER_SHARE": PARTNER_SHARE,
        "CHROMA": chroma,
        "RESOLUTIONS": min(max(3, levels), count),
        "LEAST_TIGHTNESS": LEAST_TIGHTNESS,
        "LEAST_SKEWED": LEAST_SKEWED,
        "LEAST_BOUND": LEAST_BOUND,
        "STRONGEST_SKEW": STRONGEST_SKEW,
    }


def weight_layers(levels: int, *, bent: bool) -> int:
    """Layers of the weights in weighed_noise.glsl."""
    return levels + -(-(levels + 1 + 4 * bent) // 4)


def screen_noise(ctx: moderngl.Context, size: Size, levels: int, *, wraps: bool) -> NoisePass:
    """Make the pass of noise that lies on the screen. Twin: noise_tile(), panorama_noise()."""
    edge = tile_edge(size[1], size[0])
    return NoisePass(
        ctx,
        size if wraps else (edge, edge),
        levels,
        step=GRAIN,
        most_steps=MOST_STEPS,
        margin=panorama_margin(levels) if wraps else 0,
    )


def layered(noise: NDArray[np.floating]) -> NDArray[np.int8]:
    """Noise (rows, columns, values) in steps of `GRAIN`: (layers, rows, columns, 16)."""
    rows, columns, count = noise.shape
    layers = -(-count // TEXEL_BYTES)
    steps = np.zeros((rows, columns, layers * TEXEL_BYTES), np.int8)
    steps[..., :count] = np.rint(noise / GRAIN)
    texels = steps.reshape(rows, columns, layers, TEXEL_BYTES)
    return np.ascontiguousarray(texels.transpose(2, 0, 1, 3))


def halved(size: Size) -> Size:
    """Half a size, rounded up."""
    return -(-size[0] // 2), -(-size[1] // 2)


def resolutions(size: Size, count: int) -> list[Size]:
    """A size, and `count` halvings of it."""
    return [(-(-size[0] // (1 << r)), -(-size[1] // (1 << r))) for r in range(count + 1)]


class WeighedNoisePass(PicturePass):
    """A base, and noise on the screen that weights of blocks of 4x4 pixels tell, added to it."""

    def _prepare(self, levels: int) -> None:
        """Make base, weights, noise and the last pass for so many levels."""
        width, height = self.size
        self._blocks = -(-width // 4), -(-height // 4)
        self._base = self._texture(self.size)
        self._weights = self._array(self._blocks, weight_layers(levels, bent=False), "rgba16f")
        self._noise = self._part(screen_noise(self._ctx, self.size, levels, wraps=False))
        self._finish = self._compile("finish_screen", **noise_constants(levels, BASE=False))
        self._finish["strength"] = 1.0

    def _add_noise(self, target: moderngl.Texture, seed: int) -> None:
        self._noise.set_seed(check_seed(seed))
        self._play(self._add, target)

    def _add(self, target: moderngl.Texture) -> None:
        self._finish.run_over(
            halved(self.size),
            source=self._base,
            weights=self._weights,
            noise=self._noise.texture,
            target=target,
        )

    def _read(self, draw: Callable[[moderngl.Texture], None]) -> NDArray[np.float32]:
        """Return the picture that is drawn into a texture: for callers without."""
        target = create_texture(self._ctx, self.size, "rgba32f")
        try:
            draw(target)
            return np.ascontiguousarray(read_back(target)[..., :3])
        finally:
            target.release()


class CutPass(Pass):
    """Shows one picture on one side of a line through the gaze, another on the other side.

    Parameters
    ----------
    geometry : FlatGeometry
        Of all three.
    """

    def __init__(self, ctx: moderngl.Context, geometry: FlatGeometry) -> None:
        super().__init__(ctx)
        self._geometry = geometry
        self.size = geometry.width_px, geometry.height_px
        self._shader_of_all = shader = self._shader("foveation/shaders/cut.comp.glsl", TILE=TILE)
        shader["centre_px"] = geometry.centre_px
        shader["distance_px"] = geometry.distance_px
        self._normal, self._ramp = shader.uniform("normal"), shader.uniform("ramp_deg")

    def __call__(
        self,
        first: moderngl.Texture,
        second: moderngl.Texture,
        target: moderngl.Texture,
        gaze_px: tuple[float, float],
        *,
        angle_deg: float,
        ramp_deg: float,
    ) -> None:
        """Show `first` on the left of the line's direction, `second` (rgba8 too) on its right."""
        self._normal.value = tuple(map(float, cut_normal(self._geometry, gaze_px, angle_deg)))
        self._ramp.value = ramp_deg
        self._play(self._cut, first, second, target)

    def _cut(
        self, first: moderngl.Texture, second: moderngl.Texture, target: moderngl.Texture
    ) -> None:
        check_texture(first, "first", self.size, "rgba32f")
        check_texture(second, "second", self.size, "rgba32f", "rgba8")
        check_texture(target, "target", self.size, "rgba32f")
        self._shader_of_all.run_over(self.size, first=first, second=second, target=target)
