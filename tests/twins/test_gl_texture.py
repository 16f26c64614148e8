"""Textures: what goes up comes back, and what does not fit is refused; the pool."""

import moderngl
import numpy as np
import pytest

from pipeline.errors import GLUnavailableError, InputError
from pipeline.gl.texture import (
    FORMATS,
    check_texture,
    create_texture,
    format_of,
    read_back,
    texture_from,
    upload,
)


def random_bits(rng, shape, dtype):
    """Return an array of any bit patterns, NaNs and infinities among them."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    return np.frombuffer(rng.bytes(size), dtype).reshape(shape)


def shape_of(fmt, height, width):
    return (height, width) if fmt.components == 1 else (height, width, fmt.components)


# --- Up and back


# Odd widths: rows of 1- and 2-byte texels do not end at OpenGL's default of 4 bytes.
@pytest.mark.parametrize(("width", "height"), [(1, 1), (5, 3), (7, 2), (64, 1), (33, 40)])
@pytest.mark.parametrize("name", FORMATS)
def test_every_format_comes_back_bit_for_bit(gl_context, rng, name, width, height):
    fmt = FORMATS[name]
    array = random_bits(rng, shape_of(fmt, height, width), fmt.array_dtype)
    if fmt.array_dtype in {"f2", "f4"}:  # a driver may quieten NaNs
        array = np.where(np.isnan(array), np.array(-0.0, array.dtype), array)

    texture = texture_from(gl_context, array, name)
    back = read_back(texture)
    texture.release()

    assert back.dtype == array.dtype
    assert back.shape == array.shape
    assert back.tobytes() == array.tobytes()


@pytest.mark.parametrize("name", ["rgba32f", "r16f"])
def test_nan_and_infinity_come_back_as_such(gl_context, name):
    fmt = FORMATS[name]
    array = np.zeros(shape_of(fmt, 2, 3), fmt.array_dtype)
    array[0, 0], array[1, 1], array[1, 2] = np.nan, np.inf, -np.inf

    texture = texture_from(gl_context, array, name)
    back = read_back(texture)
    texture.release()

    np.testing.assert_array_equal(back, array)


def test_row_0_of_an_array_is_texel_row_0(gl_context):
    """A shader reads texel (x, y) = (2, 1): row 1, column 2."""
    array = np.arange(12, dtype=np.float32).reshape(3, 4)
    shader = gl_context.compute_shader(
        """#version 430
        layout(local_size_x = 1) in;
        layout(binding = 0) uniform sampler2D image;
        layout(std430, binding = 0) buffer Out { float texel; };
        void main() { texel = texelFetch(image, ivec2(2, 1), 0).r; }"""
    )
    buffer = gl_context.buffer(reserve=4)
    texture = texture_from(gl_context, array, "r32f")
    texture.use(0)
    buffer.bind_to_storage_buffer(0)

    shader.run()
    gl_context.memory_barrier()
    texel = np.frombuffer(buffer.read(), np.float32)[0]
    for thing in (shader, buffer, texture):
        thing.release()

    assert texel == array[1, 2]


def test_a_view_that_is_not_contiguous_is_uploaded_as_it_looks(gl_context, rng):
    view = rng.random((6, 10), np.float32)[::-2, 1::3]

    texture = texture_from(gl_context, view, "r32f")
    back = read_back(texture)
    texture.release()

    np.testing.assert_array_equal(back, view)


def test_a_new_texture_samples_the_nearest_texel_and_does_not_repeat(gl_context):
    texture = create_texture(gl_context, (4, 4), "rgba32f")
    state = (texture.filter, texture.repeat_x, texture.repeat_y)
    texture.release()

    assert state == ((moderngl.NEAREST, moderngl.NEAREST), False, False)


def test_a_texture_knows_its_format(gl_context):
    for name in FORMATS:
        texture = create_texture(gl_context, (2, 2), name)
        assert format_of(texture).name == name
        texture.release()


# --- Refusals. None may leave a texture behind: the fixture looks.


@pytest.mark.parametrize(
    "array",
    [
        np.zeros((4, 5, 3), np.float32),
        np.zeros((5, 4, 4), np.float32),
        np.zeros((4, 5), np.float32),
        np.zeros((4, 5, 4), np.float64),
        np.zeros((4, 5, 4), np.uint8),
        np.zeros((4, 5, 4), ">f4"),
    ],
)
def test_an_array_that_does_not_fit_is_not_uploaded(gl_context, array):
    texture = texture_from(gl_context, np.ones((4, 5, 4), np.float32), "rgba32f")

    with pytest.raises(InputError, match=r"must be float32 of shape \(4, 5, 4\) for a rgba32f"):
        upload(texture, array)
    kept = read_back(texture)
    texture.release()

    np.testing.assert_array_equal(kept, 1)


@pytest.mark.parametrize(
    "array",
    [
        np.zeros((4, 5, 3), np.float32),
        np.zeros((4, 5, 4), np.float64),
        np.zeros(5, np.float32),
        np.zeros((0, 5, 4), np.float32),
    ],
)
def test_no_texture_is_made_from_an_array_that_does_not_fit(gl_context, array):
    with pytest.raises(InputError):
        texture_from(gl_context, array, "rgba32f")


def test_an_unknown_format_is_refused_with_those_there_are(gl_context):
    with pytest.raises(InputError, match=r"one of r8, .*rgba32f.* \(got 'rgb9'\)"):
        create_texture(gl_context, (4, 4), "rgb9")
    with pytest.raises(InputError, match=r"\(got 'rgb9'\)"):
        texture_from(gl_context, np.zeros((2, 2), np.float32), "rgb9")


@pytest.mark.parametrize("size", [(0, 4), (4, 0), (-1, 4)])
def test_a_texture_without_texels_is_refused(gl_context, size):
    with pytest.raises(
        InputError, match=rf"edges must lie in 1\.\.\d+ .*\(got {size[0]}x{size[1]}"
    ):
        create_texture(gl_context, size, "r8")


def test_a_texture_over_the_drivers_limit_is_refused(gl_context):
    limit = gl_context.info["GL_MAX_TEXTURE_SIZE"]

    with pytest.raises(InputError, match=rf"1\.\.{limit} on this driver \(got 1x{limit + 1}\)"):
        create_texture(gl_context, (1, limit + 1), "r8")


class FullContext:
    """The real context, but its driver answers every new texture with an error."""

    def __init__(self, ctx):
        self._ctx = ctx
        self._made = False

    def __getattr__(self, name):
        return getattr(self._ctx, name)

    def texture(self, *args, **kwargs):
        self._made = True
        return self._ctx.texture(*args, **kwargs)

    @property
    def error(self):
        return "GL_OUT_OF_MEMORY" if self._made else self._ctx.error


def test_a_driver_out_of_memory_is_told_and_nothing_is_kept(gl_context):
    with pytest.raises(
        GLUnavailableError, match=r"8x4 rgba32f texture \(it answered GL_OUT_OF_MEMORY\); use sm"
    ):
        create_texture(FullContext(gl_context), (8, 4), "rgba32f")


def test_an_error_from_before_is_not_taken_for_the_textures_own(gl_context):
    huge = gl_context.texture(
        (1, 1 + gl_context.info["GL_MAX_TEXTURE_SIZE"]), 1
    )  # GL_INVALID_VALUE

    texture = create_texture(gl_context, (4, 4), "rgba8")

    texture.release()
    huge.release()


def test_a_texture_of_a_format_of_others_is_refused(gl_context):
    foreign = gl_context.texture((2, 2), 3, dtype="f1")
    depth = gl_context.depth_texture((2, 2))

    with pytest.raises(InputError, match="got a 3-component f1 texture"):
        format_of(foreign)
    with pytest.raises(InputError, match="got a depth texture"):
        read_back(depth)
    foreign.release()
    depth.release()


@pytest.mark.parametrize(("size", "name"), [((5, 4), "rgba32f"), ((4, 5), "rgba16f")])
def test_a_pass_refuses_a_texture_of_another_size_or_format(gl_context, size, name):
    texture = create_texture(gl_context, size, name)

    check_texture(texture, "image", size, name)
    with pytest.raises(
        InputError, match=rf"image must be 4x5 rgba32f, .* \(got {size[0]}x{size[1]} {name}\)"
    ):
        check_texture(texture, "image", (4, 5), "rgba32f")
    texture.release()
