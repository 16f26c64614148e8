"""Foveated pictures on the GPU. Twin: reference.py.

A pull makes the chain of halvings and the moments of its bands, one pass a resolution; a push
chooses each texel's level of detail, one pass a resolution; between them gains are found for blocks
of 4x4 pixels. With K halvings 2 K + 1 passes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.features.gpu import band_constants
from pipeline.features.reference import fitted_kernels
from pipeline.foveation.chain import chain_length
from pipeline.foveation.condition import Look, Picture
from pipeline.foveation.geometry import (
    CapGeometry,
    EquirectangularGeometry,
    FlatGeometry,
    Geometry,
    check_gaze,
)
from pipeline.foveation.lod import FADE_SHARE, HALVED_VARIANCE
from pipeline.foveation.moments import PARTNER_SHARE, SMALLEST_VARIANCE
from pipeline.foveation.noise_plane import (
    GRAIN,
    MOST_STEPS,
    carried_noise,
    check_seed,
    noise_tile,
    panorama_noise,
    tile_edge,
)
from pipeline.foveation.pooling import Pooling
from pipeline.foveation.reference import AIM
from pipeline.foveation.settings import MetamerSettings
from pipeline.foveation.sphere import BELT_DEG, CAP_DEG
from pipeline.gl.shader import compile_compute, set_array
from pipeline.gl.texture import (
    check_texture,
    create_texture,
    create_texture_array,
    read_back,
    texture_bytes,
    texture_from,
    upload,
)
from pipeline.noise.gains import GAIN_CONSTANTS, overlap_by_levels
from pipeline.noise.mixing import LAGS, fitted_mixing
from pipeline.noise.tile import TEXELS_PER_PX

TILE = 8  # work-group edge
TEXEL_BYTES = 16  # of noise

_PROJECTIONS = {FlatGeometry: 0, EquirectangularGeometry: 1, CapGeometry: 2}  # see pools.glsl

Size = tuple[int, int]


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
        self._shaders: list[moderngl.ComputeShader | moderngl.Program] = []

    def compile(
        self, ctx: moderngl.Context, path: str, **constants: int | float | bool
    ) -> moderngl.ComputeShader:
        """Compile a shader that knows the pools."""
        shader = compile_compute(ctx, path, TILE=TILE, **self.constants, **constants)
        self.tell(shader)
        return shader

    def tell(self, shader: moderngl.ComputeShader | moderngl.Program) -> None:
        """Set what is fixed in a shader, and from now on its gaze."""
        for name, value in self._fixed.items():
            if name in shader:
                shader[name] = value
        if "gaze" in shader:
            self._shaders.append(shader)

    def look(self, gaze_px: tuple[float, float]) -> None:
        """Tell all shaders where the eye looks."""
        x, y = check_gaze(self.geometry, gaze_px)
        ray = tuple(self.geometry.directions(np.array(x), np.array(y)).tolist())
        for shader in self._shaders:
            shader["gaze"] = ray


class Holder:
    """Shaders, textures and buffers of passes over pictures of one size, freed together."""

    def __init__(self, ctx: moderngl.Context, size: Size, *, wraps: bool = False) -> None:
        self.ctx = ctx
        self.size = size
        self._wraps = wraps
        self._held: list[moderngl.Texture | moderngl.TextureArray] = []
        self._others: list[moderngl.ComputeShader | moderngl.Buffer] = []

    @property
    def held_bytes(self) -> int:
        """Memory beyond the caller's textures, bytes."""
        return sum(texture_bytes(texture) for texture in self._held)

    def release(self) -> None:
        """Free everything this pass made."""
        for held in (*self._held, *self._others):
            held.release()
        self._held, self._others = [], []

    def _texture(self, size: Size, format_name: str = "rgba32f") -> moderngl.Texture:
        """A texture that is sampled linearly, and goes on as the picture does."""
        texture = create_texture(self.ctx, size, format_name)
        self._smooth(texture)
        return texture

    def _array(
        self, size: Size, layers: int, format_name: str = "rgba32f"
    ) -> moderngl.TextureArray:
        array = create_texture_array(self.ctx, size, layers, format_name)
        self._smooth(array)
        return array

    def _smooth(self, texture: moderngl.Texture | moderngl.TextureArray) -> None:
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = self._wraps
        self._held.append(texture)

    def _keep(self, shader: moderngl.ComputeShader) -> moderngl.ComputeShader:
        self._others.append(shader)
        return shader

    def _run(self, shader: moderngl.ComputeShader, size: Size) -> None:
        shader.run(-(-size[0] // TILE), -(-size[1] // TILE))
        self.ctx.memory_barrier()

    def _draw(
        self,
        shader: moderngl.ComputeShader,
        target: moderngl.Texture,
        read: Sequence[moderngl.Texture | moderngl.TextureArray],
        size: Size,
    ) -> None:
        """Fill `target` from what is `read`, at units 0, 1, ...; `size` is counted in calls."""
        for unit, texture in enumerate(read):
            texture.use(unit)
        target.bind_to_image(0, read=False, write=True)
        self._run(shader, size)


@dataclass(frozen=True)
class Call:
    """How a pass is called: see `FoveationPass.__call__`."""

    gaze_px: tuple[float, float]
    seed: int
    noise_shift_px: moderngl.Texture | None
    field_gaze_px: tuple[float, float]


class FoveationPass(Holder):
    """A condition on the GPU, for pictures of one size.

    Compiles and allocates on construction (and once more for the first seed, and the first carried
    noise). A call binds and dispatches `dispatches` times, and reads nothing back.

    Attributes
    ----------
    carries_noise : bool
        Whether a call takes `noise_shift_px`.
    """

    carries_noise: ClassVar[bool] = True

    def __init__(self, ctx: moderngl.Context, geometry: Geometry, pooling: Pooling) -> None:
        super().__init__(ctx, (geometry.width_px, geometry.height_px), wraps=geometry.wraps)
        self.geometry = geometry
        self._pooled = Pooled(geometry, pooling)
        self._ends: tuple[moderngl.Texture, moderngl.Texture] | None = None
        self.chains: list[ChainPass] = []  # what analyses pictures

    @property
    def dispatches(self) -> int:
        """How many dispatches one call makes."""
        raise NotImplementedError

    def _show(self, source: moderngl.Texture, target: moderngl.Texture, call: Call) -> None:
        """Do what a call asks for; pools are known, and textures checked."""
        raise NotImplementedError

    def __call__(
        self,
        source: moderngl.Texture,
        target: moderngl.Texture,
        gaze_px: tuple[float, float],
        *,
        seed: int = 0,
        noise_shift_px: moderngl.Texture | None = None,
        field_gaze_px: tuple[float, float] | None = None,
    ) -> None:
        """Show `source` to an eye at `gaze_px`, into `target`: another texture, both rgba32f.

        Alpha is copied. `noise_shift_px` (rg32f) and `field_gaze_px`: see `foveate`.
        """
        for name, texture in (("source", source), ("target", target)):
            check_texture(texture, name, self.size, "rgba32f")
        if noise_shift_px is not None:
            if not self.carries_noise:
                raise ValueError("these passes cannot carry noise along; numpy can")
            check_texture(noise_shift_px, "noise_shift_px", self.size, "rg32f")
        self._pooled.look(gaze_px)
        self._show(source, target, Call(gaze_px, seed, noise_shift_px, field_gaze_px or gaze_px))

    def apply(self, picture: Picture, look: Look) -> Picture:
        """Upload, work, read back: for callers without textures."""
        if self._ends is None:
            ends = [create_texture(self.ctx, self.size, "rgba32f") for _ in range(2)]
            self._ends = (ends[0], ends[1])
        source, target = self._ends
        upload(source, np.pad(picture, ((0, 0), (0, 0), (0, 1)), constant_values=1))
        shift = None
        if look.noise_shift_px is not None:
            shift = texture_from(self.ctx, look.noise_shift_px.astype(np.float32), "rg32f")
        self(
            source,
            target,
            look.gaze_px,
            seed=look.seed,
            noise_shift_px=shift,
            field_gaze_px=look.field_gaze_px,
        )
        if shift is not None:
            shift.release()
        return np.ascontiguousarray(read_back(target)[..., :3])

    def release(self) -> None:
        for end in self._ends or ():
            end.release()
        self._ends = None
        super().release()

    def _compile(self, path: str, **constants: int | float | bool) -> moderngl.ComputeShader:
        """Compile a shader of this folder that knows the pools, and keep it."""
        return self._keep(
            self._pooled.compile(self.ctx, f"foveation/{path}.comp.glsl", **constants)
        )


class ChainPass:
    """The chain of a picture and its bands' moments, pulled, then chosen for a gaze, in place.

    Parameters
    ----------
    owner : FoveationPass
        Keeps what is made here.
    levels : int
        Pyramid levels whose moments are made; 0 for a blur.
    deepest : int
        The last resolution of the base.
    chroma : bool
        Whether moments of Cb and Cr with luma are made.
    """

    def __init__(
        self,
        owner: FoveationPass,
        pooled: Pooled,
        levels: int,
        deepest: int,
        *,
        chroma: bool = True,
    ) -> None:
        self._owner = owner
        owner.chains.append(self)
        width, height = owner.size
        self.count = chain_length(width, height)
        self.sizes = resolutions(owner.size, self.count)
        self._levels, self._deepest = levels, deepest
        low = fitted_kernels().low
        kernel = {"LOW_INNER": low[1, 1], "LOW_MIXED": low[0, 1], "LOW_OUTER": low[0, 0]}
        taps = {name: float(value) for name, value in kernel.items()} | band_constants()
        pulls: dict[tuple[bool, int], moderngl.ComputeShader] = {}
        pushes: dict[tuple[bool, int], moderngl.ComputeShader] = {}
        self._pulls, self._pushes = [], []
        # lows[0] and moments[0] stand for the picture's own, which are not kept.
        self.lows = [owner._texture(size) for size in self.sizes[1:]]
        self.moments = [
            owner._array(self.sizes[r], 2 * min(r, levels)) if levels else None
            for r in range(1, self.count + 1)
        ]
        for r in range(self.count):
            key = (r < levels, min(r, levels))
            if key not in pulls:
                pulls[key] = owner._keep(
                    compile_compute(
                        owner.ctx,
                        "foveation/pull.comp.glsl",
                        TILE=TILE,
                        WRAPS=owner.geometry.wraps,
                        OWN=key[0],
                        OLDER=key[1],
                        CHROMA=chroma,
                        **taps,
                    )
                )
            self._pulls.append(pulls[key])
        for r in range(1, self.count):
            key = (r < deepest, min(r, levels) if r > 1 else 0)
            if key not in pushes:
                pushes[key] = owner._keep(
                    pooled.compile(
                        owner.ctx, "foveation/push.comp.glsl", BASE=key[0], LAYERS=key[1]
                    )
                )
            self._pushes.append((r, pushes[key]) if any(key) else None)

    @property
    def held_bytes(self) -> int:
        """Memory of the chain and its moments, of the owner's."""
        moments = sum(texture_bytes(array) for array in self.moments if array is not None)
        return moments + sum(texture_bytes(texture) for texture in self.lows)

    @property
    def dispatches(self) -> int:
        return len(self._pulls) + sum(push is not None for push in self._pushes)

    def pull(self, source: moderngl.Texture) -> None:
        """Make all resolutions of `source`."""
        for r, shader in enumerate(self._pulls):
            (source if r == 0 else self.lows[r - 1]).use(0)
            self.lows[r].bind_to_image(0, read=False, write=True)
            if r > 0 and (older := self.moments[r - 1]) is not None:
                older.use(1)
            if (moments := self.moments[r]) is not None:
                moments.bind_to_image(1, read=False, write=True)
            self._owner._run(shader, self.sizes[r + 1])

    def push(self, last: int, first: int | None = None) -> None:
        """Choose levels of detail at resolutions from `first` (the coarsest) down to `last`."""
        for entry in reversed(self._pushes):
            if entry is None or entry[0] < last or (first is not None and entry[0] > first):
                continue
            r, shader = entry
            self.lows[r - 1].bind_to_image(0, read=True, write=True)
            self.lows[r].use(0)
            own, coarse = self.moments[r - 1], self.moments[r]
            if own is not None and coarse is not None:
                own.bind_to_image(1, read=True, write=True)
                coarse.use(1)
            shader["fine_size"] = self.sizes[r]
            shader["halvings"] = r
            self._owner._run(shader, self.sizes[r])


def sphere_constants() -> dict[str, float]:
    """What sphere.glsl is compiled with."""
    return {
        name: math.sin(math.radians(angle))
        for name, angle in (("BELT_SINE", BELT_DEG), ("CAP_SINE", CAP_DEG))
    }


def finish_constants(**changes: int | float | bool) -> dict[str, int | float | bool]:
    """What finish.comp.glsl is compiled with, unless told otherwise."""
    constants: dict[str, int | float | bool] = {
        "FADE_SHARE": FADE_SHARE,
        "NOISE": False,
        "BASE": True,
        "LEVELS": 1,
        "CARRIED": False,
        "TEXELS_PER_PX": TEXELS_PER_PX,
        "NOISE_ROWS": 1,
        "NOISE_COLUMNS": 1,
        "NOISE_SCALE": 1.0,
        **sphere_constants(),
    }
    return constants | changes


class BlurPass(FoveationPass):
    """The blur of a pooling law."""

    def __init__(self, ctx: moderngl.Context, geometry: Geometry, pooling: Pooling) -> None:
        super().__init__(ctx, geometry, pooling)
        self._chain = ChainPass(self, self._pooled, 0, chain_length(*self.size))
        self._finish = self._compile("finish", **finish_constants())

    @property
    def dispatches(self) -> int:
        return self._chain.dispatches + 1

    def _show(
        self,
        source: moderngl.Texture,
        target: moderngl.Texture,
        call: Call,  # noqa: ARG002
    ) -> None:
        self._chain.pull(source)
        self._chain.push(1)
        self._draw(self._finish, target, (source, self._chain.lows[0]), halved(self.size))


class MetamerPass(FoveationPass):
    """Noise with each pool's moments; chroma ``follow`` or ``luma``.

    Raises
    ------
    InputError, GLUnavailableError
        If the driver cannot hold pictures of this size.
    """

    def __init__(
        self, ctx: moderngl.Context, geometry: Geometry, settings: MetamerSettings
    ) -> None:
        super().__init__(ctx, geometry, settings.pooling)
        self.settings = settings
        count = chain_length(*self.size)
        self.levels = levels = min(settings.levels, count)
        self._chain = ChainPass(
            self,
            self._pooled,
            levels,
            levels if settings.residual == "kept" else count,
            chroma=settings.chroma != "luma",
        )
        overlap = overlap_by_levels(fitted_mixing(levels).overlap)
        self._overlap = ctx.buffer(overlap.tobytes())
        self._others.append(self._overlap)
        self._weights = self._array(self._chain.sizes[2], levels + -(-levels // 4), "rgba16f")
        self._gains = self._compile(
            "gains",
            LEVELS=levels,
            AIM=AIM,
            **GAIN_CONSTANTS,
            SMALLEST_VARIANCE=SMALLEST_VARIANCE,
            PARTNER_SHARE=PARTNER_SHARE,
            CHROMA=settings.chroma != "luma",
        )
        self._finish = self._compile_finish(carried=False)
        self._carried: moderngl.ComputeShader | None = None
        self._tiles: dict[bool, moderngl.TextureArray] = {}  # by whether it is carried
        self._seeds: dict[bool, int] = {}

    @property
    def dispatches(self) -> int:
        return self._chain.dispatches + 2

    @property
    def held_bytes(self) -> int:
        return super().held_bytes + self._overlap.size

    def _show(self, source: moderngl.Texture, target: moderngl.Texture, call: Call) -> None:
        carried = call.noise_shift_px is not None
        self.set_seed(call.seed, carried=carried)
        self._chain.pull(source)
        self._chain.push(2)
        self._find_gains()
        self._chain.push(1, 1)
        read: list[moderngl.Texture | moderngl.TextureArray] = [source, self._chain.lows[0]]
        read += [self._weights, self._tiles[carried]]
        if call.noise_shift_px is not None:
            read.append(call.noise_shift_px)
        finish = self._carried if carried else self._finish
        assert finish is not None
        self._draw(finish, target, read, halved(self.size))

    def set_seed(self, seed: int, *, carried: bool = False) -> None:
        """Make the noise of `seed`, unless it is the one at hand."""
        seed = check_seed(seed)
        if carried and self._carried is None:
            self._carried = self._compile_finish(carried=True)
        if self._seeds.get(carried) == seed:
            return
        if carried:
            tile = self._carried_tile(seed)
        else:
            tile = screen_noise(self.size, seed, self.levels, wraps=self.geometry.wraps)
        layers, height, width, _ = tile.shape
        if carried not in self._tiles:
            self._tiles[carried] = self._array((width, height), layers, "rgba32ui")
            self._tiles[carried].filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._tiles[carried].write(tile.tobytes())
        self._seeds[carried] = seed
        if carried and self._carried is not None:
            lags = fitted_mixing(self.levels).lag_correlation
            set_array(self._carried, "lag_correlation", lags.reshape(-1, len(LAGS)))

    def _find_gains(self) -> None:
        self._weights.bind_to_image(0, read=False, write=True)
        for unit in range(max(2, self.levels)):
            moments = self._chain.moments[unit]  # of resolution unit + 1
            assert moments is not None
            moments.use(unit)
        self._overlap.bind_to_uniform_block(0)
        self._run(self._gains, halved(self._chain.sizes[2]))

    def _compile_finish(self, *, carried: bool) -> moderngl.ComputeShader:
        width, height = self.size
        edge = tile_edge(height, width)
        rows = columns = edge * TEXELS_PER_PX if carried else edge // 2
        if self.geometry.wraps and not carried:
            rows, columns = halved((height, width))
        constants = finish_constants(
            NOISE=True,
            LEVELS=self.levels,
            CARRIED=carried,
            NOISE_ROWS=rows,
            NOISE_COLUMNS=columns,
            NOISE_SCALE=MOST_STEPS * GRAIN,
        )
        shader = self._compile("finish", **constants)
        shader["noise_scale"] = self.settings.noise
        return shader

    def _carried_tile(self, seed: int) -> NDArray[np.int8]:
        """A texel is a place with up to sixteen bands: (layers, edge * 2, edge * 2, 16)."""
        tiles = carried_noise(seed, self.levels, 1, tile_edge(*self.size)).tiles[:, 0]
        levels, edge = tiles.shape[:2]
        return _layered(tiles.transpose(1, 2, 0, 3).reshape(edge, edge, 3 * levels))


def screen_noise(size: Size, seed: int, levels: int, *, wraps: bool) -> NDArray[np.int8]:
    """Noise that lies on the screen, as finish.comp.glsl reads it.

    A texel holds 2x2 pixels of four bands: (layers, rows / 2, columns / 2, 16).
    """
    width, height = size
    if wraps:
        tile = panorama_noise(seed, levels, 1, height)[:, :, 0]
        tile = np.pad(tile, ((0, height % 2), (0, 0), (0, 0)))
    else:
        tile = noise_tile(seed, levels, 1, tile_edge(height, width))[:, :, 0]
    rows, columns, bands = tile.shape
    cells = tile.reshape(rows // 2, 2, columns // 2, 2, bands).transpose(0, 2, 4, 1, 3)
    return _layered(cells.reshape(rows // 2, columns // 2, 4 * bands))


def _layered(noise: NDArray[np.floating]) -> NDArray[np.int8]:
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
