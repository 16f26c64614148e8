"""Foveated pictures on the GPU. Twin: reference.py.

A pull makes the chain of halvings and the moments of its bands, one pass a resolution; a push
chooses each texel's level of detail, one pass a resolution; between them gains are found for blocks
of 4x4 pixels. With K halvings 2 K + 1 passes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.features.gpu import band_constants, low_constants
from pipeline.foveation.chain import chain_length
from pipeline.foveation.geometry import (
    CapGeometry,
    EquirectangularGeometry,
    FlatGeometry,
    Geometry,
    check_gaze,
)
from pipeline.foveation.lod import FADE_SHARE, HALVED_VARIANCE
from pipeline.foveation.look import Look, Picture
from pipeline.foveation.moments import PARTNER_SHARE, SMALLEST_VARIANCE
from pipeline.foveation.noise_plane import (
    GRAIN,
    carried_noise,
    check_seed,
    noise_tile,
    panorama_noise,
    tile_edge,
)
from pipeline.foveation.pooling import Pooling
from pipeline.foveation.reference import AIM, MOST_BEND
from pipeline.foveation.settings import MetamerSettings
from pipeline.foveation.sphere import BELT_DEG, CAP_DEG
from pipeline.gl.compute import Resource, Shader
from pipeline.gl.passes import Pass
from pipeline.gl.shader import Constant
from pipeline.gl.texture import check_texture, create_texture, read_back, texture_from, upload
from pipeline.noise.gains import gain_constants
from pipeline.noise.mixing import LAGS, fitted_mixing
from pipeline.noise.tile import TEXELS_PER_PX

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
        self._shaders: list[Shader | moderngl.Program] = []

    def tell(self, shader: S) -> S:
        """Tell a shader what stays, and from now on the gaze."""
        for name, value in self._fixed.items():
            if name in shader:
                shader[name] = value
        if "gaze" in shader:
            self._shaders.append(shader)
        return shader

    def look(self, gaze_px: tuple[float, float]) -> None:
        """Tell all shaders where the eye looks."""
        x, y = check_gaze(self.geometry, gaze_px)
        ray = tuple(self.geometry.directions(np.array(x), np.array(y)).tolist())
        for shader in self._shaders:
            shader["gaze"] = ray


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


@dataclass(frozen=True)
class Call:
    """How a pass is called: see `FoveationPass.__call__`."""

    gaze_px: tuple[float, float]
    seed: int
    noise_shift_px: moderngl.Texture | None
    field_gaze_px: tuple[float, float]


class FoveationPass(PicturePass):
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
        self._eye = Pooled(geometry, pooling)
        size = geometry.width_px, geometry.height_px
        super().__init__(ctx, size, self._eye, wraps=geometry.wraps)
        self.geometry = geometry
        self._ends: tuple[moderngl.Texture, moderngl.Texture] | None = None
        self.chains: list[ChainPass] = []  # what analyses pictures

    @property
    def dispatches(self) -> int:
        """How many dispatches one call makes."""
        raise NotImplementedError

    def _analysis(self, levels: int, deepest: int, *, chroma: bool = True) -> ChainPass:
        # Moments of resolution 2 are chosen where they are read, in gains.comp.glsl.
        chain = ChainPass(self._ctx, self._eye, levels, deepest, chroma=chroma, finest=3)
        self._part(chain)
        self.chains.append(chain)
        return chain

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
        self._eye.look(gaze_px)
        self._show(source, target, Call(gaze_px, seed, noise_shift_px, field_gaze_px or gaze_px))

    def apply(self, picture: Picture, look: Look) -> Picture:
        """Upload, work, read back: for callers without textures."""
        if self._ends is None:
            ends = [create_texture(self._ctx, self.size, "rgba32f") for _ in range(2)]
            self._ends = (ends[0], ends[1])
        source, target = self._ends
        upload(source, np.pad(picture, ((0, 0), (0, 0), (0, 1)), constant_values=1))
        shift = None
        if look.noise_shift_px is not None:
            shift = texture_from(self._ctx, look.noise_shift_px.astype(np.float32), "rg32f")
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


class ChainPass(PicturePass):
    """The chain of a picture and its bands' moments, pulled, then chosen for a gaze, in place.

    Parameters
    ----------
    pooled : Pooled
        Geometry, law and gaze.
    levels : int
        Pyramid levels whose moments are made; 0 for a blur.
    deepest : int
        The last resolution of the base.
    chroma : bool
        Whether moments of Cb and Cr are made.
    finest : int
        The last resolution at which moments are chosen.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        pooled: Pooled,
        levels: int,
        deepest: int,
        *,
        chroma: bool = True,
        finest: int = 2,
    ) -> None:
        geometry = pooled.geometry
        size = geometry.width_px, geometry.height_px
        super().__init__(ctx, size, pooled, wraps=geometry.wraps)
        self.count = chain_length(*size)
        self.sizes = resolutions(size, self.count)
        taps = {"TILE": TILE, "WRAPS": geometry.wraps, **low_constants(), **band_constants()}
        # lows[0] and moments[0] stand for the picture's own, which are not kept.
        self.lows = [self._texture(size) for size in self.sizes[1:]]
        self.moments = [
            self._array(self.sizes[r], 2 * min(r, levels)) if levels else None
            for r in range(1, self.count + 1)
        ]
        # Powers of chroma, of resolutions from 2.
        has_powers = levels > 0 and chroma
        self.powers = [
            self._array(self.sizes[r], 2) if has_powers and r > 1 else None
            for r in range(1, self.count + 1)
        ]
        pulled = [
            (r < levels, min(r, levels), min(r, 2) if has_powers else 0) for r in range(self.count)
        ]
        made = {
            (own, older, powers): self._shader(
                "foveation/pull.comp.glsl",
                CHROMA=chroma,
                OWN=own,
                OLDER=older,
                POWERS=powers,
                **taps,
            )
            for own, older, powers in dict.fromkeys(pulled)
        }
        self._pulls = [made[key] for key in pulled]
        pushed = {
            r: (r < deepest, min(r, levels) if r >= finest else 0) for r in range(1, self.count)
        }
        pushes = {
            (base, layers): self._compile(
                "push", BASE=base, LAYERS=layers, POWERS=has_powers and layers > 0
            )
            for base, layers in dict.fromkeys(pushed.values())
            if base or layers
        }
        self._pushes = [(r, pushes[key]) for r, key in pushed.items() if any(key)]

    @property
    def dispatches(self) -> int:
        """How many dispatches a pull and a push make."""
        return len(self._pulls) + len(self._pushes)

    def pull(self, source: moderngl.Texture) -> None:
        """Make all resolutions of `source`."""
        for r, shader in enumerate(self._pulls):
            fine = self.lows[r - 1] if r else source
            shader.run_over(
                self.sizes[r + 1],
                fine=fine,
                coarse=self.lows[r],
                **self._statistics(r),
            )

    def push(self, last: int, first: int | None = None) -> None:
        """Choose levels of detail at resolutions from `first` (the coarsest) down to `last`."""
        for r, shader in reversed(self._pushes):
            if r < last or (first is not None and r > first):
                continue
            shader["fine_size"] = self.sizes[r]
            shader["halvings"] = r
            shader.run_over(
                self.sizes[r],
                fine=self.lows[r - 1],
                coarse=self.lows[r],
                **self._statistics(r),
            )

    def _statistics(self, r: int) -> dict[str, Resource]:
        """Those of resolutions `r` and r + 1."""
        return _given(
            fine_moments=self.moments[r - 1] if r else None,
            coarse_moments=self.moments[r],
            fine_powers=self.powers[r - 1] if r else None,
            coarse_powers=self.powers[r],
        )


def _given(**resources: Resource | None) -> dict[str, Resource]:
    """Those that are there."""
    return {name: one for name, one in resources.items() if one is not None}


def sphere_constants() -> dict[str, float]:
    """What sphere.glsl is compiled with."""
    return {
        name: math.sin(math.radians(angle))
        for name, angle in (("BELT_SINE", BELT_DEG), ("CAP_SINE", CAP_DEG))
    }


def finish_constants(**changes: Constant) -> dict[str, Constant]:
    """What finish.comp.glsl is compiled with, unless told otherwise."""
    constants: dict[str, Constant] = {
        "FADE_SHARE": FADE_SHARE,
        "NOISE": False,
        "BASE": True,
        "LEVELS": 1,
        "BENT": False,
        "SMALLEST_VARIANCE": SMALLEST_VARIANCE,
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
        self._chain = self._analysis(0, chain_length(*self.size))
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
        self._finish.run_over(
            halved(self.size), source=source, coarse=self._chain.lows[0], target=target
        )


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
        self._chroma = settings.chroma != "luma"
        deepest = levels if settings.residual == "kept" else count
        self._chain = self._analysis(levels, deepest, chroma=self._chroma)
        layers = levels + -(-(levels + 2 * self._chroma) // 4)
        self._weights = self._array(self._chain.sizes[2], layers, "rgba16f")
        self._gains = self._compile(
            "gains",
            **gain_constants(levels, aim=AIM),
            SMALLEST_VARIANCE=SMALLEST_VARIANCE,
            PARTNER_SHARE=PARTNER_SHARE,
            CHROMA=self._chroma,
            COARSER=count > 2,
            MOST_BEND=MOST_BEND,
        )
        self._gains.hold(weights=self._weights)
        self._finish = self._compile_finish(carried=False)
        self._carried: Shader | None = None
        self._tiles: dict[bool, moderngl.TextureArray] = {}  # by whether it is carried
        self._seeds: dict[bool, int] = {}

    @property
    def dispatches(self) -> int:
        return self._chain.dispatches + 2

    def _show(self, source: moderngl.Texture, target: moderngl.Texture, call: Call) -> None:
        carried = call.noise_shift_px is not None
        self.set_seed(call.seed, carried=carried)
        self._chain.pull(source)
        self._chain.push(2)
        self._find_gains()
        self._chain.push(1, 1)
        finish = self._carried if carried else self._finish
        assert finish is not None
        finish.run_over(
            halved(self.size),
            source=source,
            coarse=self._chain.lows[0],
            weights=self._weights,
            noise=self._tiles[carried],
            target=target,
            **_given(shift_px=call.noise_shift_px),
        )

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
            self._carried["lag_correlation"] = lags.reshape(-1, len(LAGS))

    def _find_gains(self) -> None:
        # Of resolutions 1 and 2 as they were pulled, of the others as they were chosen.
        chain = self._chain
        last = min(max(3, self.levels), chain.count)
        moments = {f"moments_{r}": chain.moments[r - 1] for r in range(1, last + 1)}
        powers = {f"powers_{r}": chain.powers[r - 1] for r in range(2, min(3, chain.count) + 1)}
        self._gains.run_over(halved(chain.sizes[2]), **_given(**moments, **powers))

    def _compile_finish(self, *, carried: bool) -> Shader:
        width, height = self.size
        edge = tile_edge(height, width)
        rows = columns = edge * TEXELS_PER_PX if carried else edge // 2
        if self.geometry.wraps and not carried:
            rows, columns = halved((height, width))
        constants = finish_constants(
            NOISE=True,
            LEVELS=self.levels,
            BENT=self._chroma,
            CARRIED=carried,
            NOISE_ROWS=rows,
            NOISE_COLUMNS=columns,
            NOISE_SCALE=GRAIN,
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
