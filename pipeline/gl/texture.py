"""Textures of named formats: creation, upload and read back.

Arrays are (row, column[, channel]); the GPU's (width, height) stays inside this module
and the pass hosts. Row 0 of an array is texel row 0.
"""

from dataclasses import dataclass
from typing import TypeVar

import moderngl
import numpy as np

from pipeline.errors import GLUnavailableError, InputError
from pipeline.frame import AnyArray


@dataclass(frozen=True)
class Format:
    """One texel format, by its GLSL image-format name."""

    name: str
    components: int
    gl_dtype: str  # moderngl's code
    array_dtype: str  # numpy's code

    @property
    def bytes_per_texel(self) -> int:
        return self.components * np.dtype(self.array_dtype).itemsize


FORMATS = {
    fmt.name: fmt
    for fmt in (
        Format("r8", 1, "f1", "u1"),
        Format("rgba8", 4, "f1", "u1"),
        Format("r16f", 1, "f2", "f2"),
        Format("rg16f", 2, "f2", "f2"),
        Format("rgba16f", 4, "f2", "f2"),
        Format("r32f", 1, "f4", "f4"),
        Format("rg32f", 2, "f4", "f4"),
        Format("rgba32f", 4, "f4", "f4"),
        Format("r32ui", 1, "u4", "u4"),
        Format("rg32ui", 2, "u4", "u4"),
        Format("rgba32ui", 4, "u4", "u4"),
        Format("r32i", 1, "i4", "i4"),
        Format("rgba32i", 4, "i4", "i4"),
    )
}
_BY_DTYPE = {(fmt.components, fmt.gl_dtype): fmt for fmt in FORMATS.values()}

T = TypeVar("T", moderngl.Texture, moderngl.TextureArray)


def format_of(texture: moderngl.Texture) -> Format:
    """Return the format `texture` was made with.

    Raises
    ------
    InputError
        If it is none of `FORMATS`: the texture was made elsewhere.
    """
    fmt = None if texture.depth else _BY_DTYPE.get((texture.components, texture.dtype))
    if fmt is None:
        kind = "depth" if texture.depth else f"{texture.components}-component {texture.dtype}"
        raise InputError(f"a texture must have one of {', '.join(FORMATS)} (got a {kind} texture)")
    return fmt


def image_format(texture: moderngl.Texture | moderngl.TextureArray) -> str:
    """The name of a texture's format; "none of ours" for one that was made elsewhere."""
    fmt = _BY_DTYPE.get((texture.components, texture.dtype))
    return fmt.name if fmt else "none of ours"


def check_texture(
    texture: moderngl.Texture, name: str, size: tuple[int, int], *formats: str
) -> None:
    """Require one size (width, height) and one of these formats of a texture given to a pass.

    Raises
    ------
    InputError
        Naming the texture, what the pass was built for and what was found.
    """
    found = format_of(texture).name
    if texture.size != size or found not in formats:
        raise InputError(
            f"{name} must be {size[0]}x{size[1]} {' or '.join(formats)}, as this pass was built"
            f" (got {texture.width}x{texture.height} {found})"
        )


def create_texture(
    ctx: moderngl.Context, size: tuple[int, int], format_name: str
) -> moderngl.Texture:
    """Make an uninitialised texture.

    Parameters
    ----------
    size : (width, height)
        Texels, each at least 1 and at most the driver's limit.
    format_name : str
        A key of `FORMATS`.

    Raises
    ------
    InputError
        If the size is outside the driver's limits or the format unknown.
    GLUnavailableError
        If the driver refuses (out of memory, for one).
    """
    fmt = _format_named(format_name)
    check_size(ctx, size)
    ctx.clear_errors()  # forget what earlier calls left behind
    texture = ctx.texture(size, fmt.components, dtype=fmt.gl_dtype)
    return _held(ctx, texture, f"a {size[0]}x{size[1]} {format_name} texture")


def create_texture_array(
    ctx: moderngl.Context, size: tuple[int, int], layers: int, format_name: str
) -> moderngl.TextureArray:
    """Make an uninitialised array of `layers` textures of one size (width, height).

    Raises
    ------
    InputError, GLUnavailableError
        As `create_texture`; also if the driver has no arrays of so many layers.
    """
    fmt = _format_named(format_name)
    check_size(ctx, size)
    limit = int(ctx.info["GL_MAX_ARRAY_TEXTURE_LAYERS"])
    if not 1 <= layers <= limit:
        raise InputError(f"layers must lie in 1..{limit} on this driver (got {layers})")
    ctx.clear_errors()
    array = ctx.texture_array((*size, layers), fmt.components, dtype=fmt.gl_dtype)
    return _held(ctx, array, f"{layers} textures of {size[0]}x{size[1]} {format_name}")


def _held(ctx: moderngl.Context, texture: T, what: str) -> T:
    """A texture that was asked for, if the driver has it, and how it is read."""
    if (error := ctx.error) != "GL_NO_ERROR":
        texture.release()
        raise GLUnavailableError(
            f"the driver must hold {what}"
            f" (it answered {error}); use smaller images or free GPU memory"
        )
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    texture.repeat_x = texture.repeat_y = False
    return texture


def texture_bytes(texture: moderngl.Texture | moderngl.TextureArray) -> int:
    """Memory of a texture that `create_texture` or `create_texture_array` made."""
    if isinstance(texture, moderngl.TextureArray):
        fmt = _BY_DTYPE[texture.components, texture.dtype]
        return texture.width * texture.height * texture.layers * fmt.bytes_per_texel
    return texture.width * texture.height * format_of(texture).bytes_per_texel


def check_size(ctx: moderngl.Context, size: tuple[int, int]) -> None:
    """Require texture edges, (width, height), that `ctx` can hold.

    Raises
    ------
    InputError
        If an edge is below 1 or above the driver's limit.
    """
    limit = int(ctx.info["GL_MAX_TEXTURE_SIZE"])
    if not all(1 <= edge <= limit for edge in size):
        raise InputError(
            f"texture edges must lie in 1..{limit} on this driver (got {size[0]}x{size[1]})"
        )


def upload(texture: moderngl.Texture, array: AnyArray) -> None:
    """Copy `array` of shape (height, width[, components]) into `texture`.

    Raises
    ------
    InputError
        If shape or dtype differ from the texture's.
    """
    fmt = format_of(texture)
    _check_array(array, fmt, _shape(texture.size, fmt))
    texture.write(np.ascontiguousarray(array), alignment=1)


def read_back(texture: moderngl.Texture) -> AnyArray:
    """Copy `texture` into a new array of shape (height, width[, components]).

    What a shader stored arrives only after a memory barrier, which is the writing pass's.
    """
    fmt = format_of(texture)
    array = np.empty(_shape(texture.size, fmt), dtype=fmt.array_dtype)
    texture.read_into(array, alignment=1)
    return array


def texture_from(ctx: moderngl.Context, array: AnyArray, format_name: str) -> moderngl.Texture:
    """Make a texture of `array`'s size and upload it.

    Raises
    ------
    InputError, GLUnavailableError
        As `create_texture` and `upload`; no texture is left behind.
    """
    fmt = _format_named(format_name)
    size = (array.shape[1], array.shape[0]) if array.ndim >= 2 else (1, array.size)
    _check_array(array, fmt, _shape(size, fmt))
    texture = create_texture(ctx, size, format_name)
    upload(texture, array)
    return texture


def _format_named(name: str) -> Format:
    if name not in FORMATS:
        raise InputError(f"format_name must be one of {', '.join(FORMATS)} (got {name!r})")
    return FORMATS[name]


def _shape(size: tuple[int, int], fmt: Format) -> tuple[int, ...]:
    plane = (size[1], size[0])
    return plane if fmt.components == 1 else (*plane, fmt.components)


def _check_array(array: AnyArray, fmt: Format, shape: tuple[int, ...]) -> None:
    if array.shape != shape or array.dtype != np.dtype(fmt.array_dtype):
        raise InputError(
            f"array must be {np.dtype(fmt.array_dtype)} of shape {shape} for a {fmt.name} texture"
            f" (got {array.dtype} of shape {array.shape})"
        )
