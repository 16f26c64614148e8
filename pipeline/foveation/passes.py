"""What passes over foveated pictures share: pools, sizes, noise that lies on the screen."""

from __future__ import annotations

import math
import struct
from typing import Any, TypeVar

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.foveation.bounded import BOUND_CONSTANTS
from pipeline.foveation.geometry import (
    CapGeometry,
    EquirectangularGeometry,
    FlatGeometry,
    Geometry,
    check_gaze,
)
from pipeline.foveation.lod import FADE_SHARE, HALVED_VARIANCE
from pipeline.foveation.noise_plane import (
    GRAIN,
    MOST_STEPS,
    ROOT_HALF_16BIT,
    check_seed,
    panorama_noise,
    part_places_px,
    part_steps,
    tile_edge,
)
from pipeline.foveation.pooling import Pooling
from pipeline.foveation.reference import FIRST_SMOOTH, MOST_BEND
from pipeline.foveation.sphere import BELT_DEG, CAP_DEG
from pipeline.gl.compute import Shader
from pipeline.gl.passes import Pass
from pipeline.gl.shader import Constant

TILE = 8  # work-group edge
TEXEL_BYTES = 16  # of noise

_PROJECTIONS = {FlatGeometry: 0, EquirectangularGeometry: 1, CapGeometry: 2}  # see pools.glsl

Size = tuple[int, int]
S = TypeVar("S", Shader, moderngl.Program)


class Pooled:
    """What every shader with pools.glsl is told: the geometry and law once, the gaze per call."""

    def __init__(self, geometry: Geometry, pooling: Pooling) -> None:
        self.geometry = geometry
        self.constants = {
            "PROJECTION": _PROJECTIONS[type(geometry)],
            "POWER": pooling.power,
            "HALVED_VARIANCE": HALVED_VARIANCE,
        }
        self._fixed: dict[str, Any] = {
            "picture_px": (geometry.width_px, geometry.height_px),
            "slope": pooling.slope,
            "fovea_deg": pooling.fovea_deg,
        }
        if isinstance(geometry, FlatGeometry):
            self._fixed |= {"centre_px": geometry.centre_px, "distance_px": geometry.distance_px}
        elif isinstance(geometry, EquirectangularGeometry):
            self._fixed["least_cosine"] = geometry.least_cosine
        elif isinstance(geometry, CapGeometry):
            self._fixed |= {"radian_px": geometry.radian_px, "pole": geometry.pole}
        self._gazes: list[moderngl.Uniform] = []
        self._looks_at: tuple[float, float] | None = None
        self._ray: bytes | None = None

    def tell(self, shader: S) -> S:
        """Tell a shader what stays, and the gaze, now and from now on."""
        for name, value in self._fixed.items():
            if name in shader:
                shader[name] = value
        if "gaze" in shader:
            uniform: Any = shader.uniform("gaze") if isinstance(shader, Shader) else shader["gaze"]
            self._gazes.append(uniform)
            if self._ray is not None:
                self._gazes[-1].write(self._ray)
        return shader

    def look(self, gaze_px: tuple[float, float]) -> None:
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
        pooled: Pooled,
        *,
        wraps: bool = False,
    ) -> None:
        super().__init__(ctx)
        self.size = size
        self._pooled = pooled
        self._wraps = wraps

    def _compile(self, name: str, **constants: Constant) -> Shader:
        """Compile a shader of this folder that knows the pools."""
        path = f"foveation/{name}.comp.glsl"
        known = self._pooled.constants
        return self._pooled.tell(self._shader(path, TILE=TILE, **known, **constants))

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
    """What sphere.glsl is compiled with."""
    return {
        name: math.sin(math.radians(angle))
        for name, angle in (("BELT_SINE", BELT_DEG), ("CAP_SINE", CAP_DEG))
    }


def noise_constants(levels: int, **changes: Constant) -> dict[str, Constant]:
    """What shaders with weighed_noise.glsl are compiled with, unless told otherwise."""
    constants: dict[str, Constant] = {
        "FADE_SHARE": FADE_SHARE,
        "LEVELS": levels,
        "BASE": True,
        "BENT": False,
        "MOST_BEND": MOST_BEND,
        "FIRST_SMOOTH": FIRST_SMOOTH,
        "NOISE_SCALE": GRAIN,
        **BOUND_CONSTANTS,
        **sphere_constants(),
    }
    return constants | changes


def weight_layers(levels: int, *, bent: bool) -> int:
    """Layers of the weights in weighed_noise.glsl."""
    return levels + -(-(levels + 1 + 3 * bent) // 4)


class ScreenNoise(Pass):
    """Noise of one seed at a time that lies on the screen, as finish_screen.comp.glsl reads it.

    Of a flat picture it is made on the GPU from two tiles that stay.
    """

    def __init__(self, ctx: moderngl.Context, size: Size, levels: int, *, wraps: bool) -> None:
        super().__init__(ctx)
        self._levels, self._seed = levels, -1
        self._height_px = size[1] if wraps else None
        self._edge = tile_edge(size[1], size[0])
        edges = halved(size) if wraps else (self._edge // 2, self._edge // 2)
        layers = -(-3 * levels // 4)
        self.texture = self._array(edges, layers, "rgba32ui")
        if wraps:
            return
        parts = self._array(edges, 2 * layers, "rgba32ui")
        cells = [of_cells(part_steps(part, levels, 1, self._edge)[:, :, 0]) for part in (0, 1)]
        parts.write(np.concatenate(cells).tobytes())
        constants = {"MOST_STEPS": MOST_STEPS, "ROOT_HALF_16BIT": ROOT_HALF_16BIT}
        self._add = self._shader("foveation/noise_seed.comp.glsl", TILE=TILE, **constants)
        self._add.hold(parts=parts, noise=self.texture)

    def set_seed(self, seed: int) -> None:
        """Make the noise of `seed`, unless it is the one at hand."""
        seed = check_seed(seed)
        if seed == self._seed:
            return
        if self._height_px is not None:
            noise = panorama_noise(seed, self._levels, 1, self._height_px)[:, :, 0] / GRAIN
            even = np.pad(noise, ((0, self._height_px % 2), (0, 0), (0, 0)))
            self.texture.write(of_cells(np.rint(even).astype(np.int8)).tobytes())
        else:
            (down, right), (down_too, right_too) = part_places_px(seed, self._edge)
            self._add["moved"] = right // 2, down // 2, right_too // 2, down_too // 2
            self._add.run_over((self.texture.width, self.texture.height))
        self._seed = seed


def of_cells(steps: NDArray[np.int8]) -> NDArray[np.int8]:
    """Steps (rows, columns, bands) by 2x2 pixels, four bands a texel: (layers, h, w, 16)."""
    rows, columns, bands = steps.shape
    cells = steps.reshape(rows // 2, 2, columns // 2, 2, bands).transpose(0, 2, 4, 1, 3)
    return layered(cells.reshape(rows // 2, columns // 2, 4 * bands))


def layered(steps: NDArray[np.int8]) -> NDArray[np.int8]:
    """Steps (rows, columns, values) as texels of words: (layers, rows, columns, 16)."""
    rows, columns, count = steps.shape
    layers = -(-count // TEXEL_BYTES)
    padded = np.zeros((rows, columns, layers * TEXEL_BYTES), np.int8)
    padded[..., :count] = steps
    texels = padded.reshape(rows, columns, layers, TEXEL_BYTES)
    return np.ascontiguousarray(texels.transpose(2, 0, 1, 3))


def halved(size: Size) -> Size:
    """Half a size, rounded up."""
    return -(-size[0] // 2), -(-size[1] // 2)


def resolutions(size: Size, count: int) -> list[Size]:
    """A size, and `count` halvings of it."""
    return [(-(-size[0] // (1 << r)), -(-size[1] // (1 << r))) for r in range(count + 1)]
