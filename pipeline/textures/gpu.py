"""A baked texture on the GPU, and the programs that draw surfaces with it."""

from __future__ import annotations

from typing import Any, Literal

import moderngl
import numpy as np

from pipeline.errors import GLUnavailableError
from pipeline.foveation.noise_plane import GRAIN
from pipeline.foveation.picture_pass import PoolUniforms
from pipeline.foveation.pooled_moments import BOUND_CONSTANTS
from pipeline.frame import AnyArray
from pipeline.gl.shader import Constant, flatten
from pipeline.gl.texture import check_size
from pipeline.noise.gains import UNSEEN_VARIANCE
from pipeline.textures.bake import BakedTexture
from pipeline.textures.surface_noise import (
    LEAST_GAIN,
    MOST_GAIN,
    NOISE_PER_TEXEL,
    REACH,
    STAGES,
    STEPS,
    SurfaceNoise,
    fitted_overlap,
    surface_noise,
)

Output = Literal["colour", "fragments"]
_NOISE_UNIT, _COLOUR_UNIT, _FIRST_MOMENTS_UNIT = 0, 1, 2


class TexturePass:
    """A baked texture for the eye of one picture: compile once, then draw what you like.

    Parameters
    ----------
    vertex : str
        GLSL 4.30 that gives ``gl_Position``, ``uv`` in 0..1 and ``light``, a linear factor. Rows of
        the picture go down, so that ``gl_FragCoord`` are its pixels.
    levels : int
        No pool is wider than so many halvings of the picture's pixels.
    seed : int
        Of the noise.

    Raises
    ------
    InputError, GLUnavailableError
        If the driver cannot hold the texture.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        baked: BakedTexture,
        pooled: PoolUniforms,
        vertex: str,
        *,
        levels: int,
        seed: int = 0,
    ) -> None:
        self._held: list[moderngl.Program] = []
        self._textures: dict[int, moderngl.Texture] = {}
        layout = baked.layout
        if layout.halvings + _FIRST_MOMENTS_UNIT > int(ctx.info["GL_MAX_TEXTURE_IMAGE_UNITS"]):
            raise GLUnavailableError(
                f"the driver must have {layout.halvings + _FIRST_MOMENTS_UNIT} texture units"
                " for a texture of this size; use a smaller one"
            )
        self._programs: dict[Output, moderngl.Program] = {}
        constants: dict[str, Constant] = {
            "HALVINGS": layout.halvings,
            "WRAPS": layout.wraps,
            "GRAIN": GRAIN,
            "NOISE_PER_TEXEL": NOISE_PER_TEXEL,
            "OVERLAP_REACH": REACH,
            "OVERLAP_STAGES": STAGES,
            "GAIN_STEPS": STEPS,
            "LEAST_GAIN": LEAST_GAIN,
            "MOST_GAIN": MOST_GAIN,
            "UNSEEN_VARIANCE": UNSEEN_VARIANCE,
            **BOUND_CONSTANTS,
        }
        outputs: tuple[tuple[Output, str, dict[str, Any]], ...] = (
            ("colour", "material", constants),
            ("fragments", "fragments", {}),
        )
        for name, file, own in outputs:
            known = {**pooled.constants, "LEVELS": levels, **own}
            source = flatten(f"textures/{file}.frag.glsl", known)
            made = ctx.program(vertex_shader=vertex, fragment_shader=source.text)
            pooled.tell(made)
            _set(made, "texture_px", (layout.width, layout.height))
            self._programs[name] = made
            self._held.append(made)
        self._upload(ctx, baked, surface_noise(seed, layout))

    def program(self, output: Output) -> moderngl.Program:
        """Program that draws ``colour``, or ``fragments``: x, y on the texture, rho and eta."""
        return self._programs[output]

    def use(self, output: Output, *, foveated: bool, strength: float = 1.0) -> moderngl.Program:
        """Bind textures, and say what is drawn; `strength` of the noise, 0: a blur."""
        for unit, texture in self._textures.items():
            texture.use(unit)
        chosen = self._programs[output]
        _set(chosen, "foveated", foveated)
        _set(chosen, "strength", strength)
        return chosen

    @property
    def held_bytes(self) -> int:
        """Memory of the texture, its moments and their noise, bytes."""
        return sum(
            texture.width * texture.height * texture.components * int(texture.dtype[1:])
            for texture in self._textures.values()
        )

    def release(self) -> None:
        """Free everything that was made here."""
        for program in self._held:
            program.release()
        for texture in self._textures.values():
            texture.release()
        self._held, self._textures = [], {}

    def _upload(self, ctx: moderngl.Context, baked: BakedTexture, noise: SurfaceNoise) -> None:
        shader, levels = self._programs["colour"], range(baked.layout.halvings)
        tiles = [
            np.ascontiguousarray(np.pad(tile, ((0, 0), (0, 0), (0, 1)))).view(np.uint32)
            for tile in noise.tiles
        ]
        self._textures = {
            _NOISE_UNIT: _stacked(ctx, tiles, 1, "u4"),
            _COLOUR_UNIT: _stacked(ctx, baked.colour, 3, "f1"),
        }
        for level in levels:
            mips = [np.ascontiguousarray(mip).view(np.uint32) for mip in baked.moments[level]]
            self._textures[_FIRST_MOMENTS_UNIT + level] = _stacked(ctx, mips, 4, "u4")
        starts = np.cumsum([0, *(len(tile) for tile in noise.tiles)])
        tile_of = [
            (int(starts[n]), noise.tiles[n].shape[0], noise.tiles[n].shape[1], 0)
            for n in noise.tile_of_level
        ]
        _set(shader, "noise_tiles", _NOISE_UNIT)
        _set(shader, "colour_mips", _COLOUR_UNIT)
        _set(shader, "moment_mips", tuple(_FIRST_MOMENTS_UNIT + level for level in levels))
        _set(shader, "noise_of_level", tile_of)
        _set(shader, "noise_offset_px", [tuple(row) for row in noise.offset_px.tolist()])
        _set(shader, "noise_lags", [tuple(row) for row in noise.lag_correlation.tolist()])
        forms = fitted_overlap().reshape(-1, 3, 3).transpose(0, 2, 1)  # column by column
        _set(shader, "overlap", [tuple(form.ravel().tolist()) for form in forms])


def _set(shader: moderngl.Program, name: str, value: Any) -> None:
    """Set a uniform that the shader uses."""
    uniform = shader.get(name, None)
    if isinstance(uniform, moderngl.Uniform):
        whole = isinstance(value, list | tuple) and uniform.array_length > 1
        uniform.value = (
            value[: uniform.array_length]
            if whole
            else (value[0] if isinstance(value, list) else value)
        )


def _stacked(ctx: moderngl.Context, images: Any, components: int, dtype: str) -> moderngl.Texture:
    """Images (h, w, components), the first the widest, below one another in one texture."""
    width = max(image.shape[1] for image in images)
    size = width, sum(len(image) for image in images)
    check_size(ctx, size)
    ctx.clear_errors()
    texture = ctx.texture(size, components, dtype=dtype, alignment=1)
    if (error := ctx.error) != "GL_NO_ERROR":
        texture.release()
        raise GLUnavailableError(
            f"the driver must hold a texture of {size[0]}x{size[1]} (it answered {error});"
            " use a smaller texture or free GPU memory"
        )
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    row = 0
    for image in images:
        data: AnyArray = np.ascontiguousarray(image)
        texture.write(data.tobytes(), (0, row, image.shape[1], len(image)), alignment=1)
        row += len(image)
    return texture
