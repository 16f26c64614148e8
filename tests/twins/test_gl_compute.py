"""Compute shaders called by name: what is bound, what is refused, and when others may read."""

import ctypes
import gc
import platform
from pathlib import Path

import numpy as np
import pytest

from pipeline.gl.compute import Shader, let_go
from pipeline.gl.passes import Pass
from pipeline.gl.shader import ShaderError, ShaderSource
from pipeline.gl.texture import create_texture, create_texture_array, read_back, texture_from

HEAD, STATUS = "#version 430\n", Path("/proc/self/status")
SUM = """
#define TILE 4
layout(local_size_x = TILE, local_size_y = TILE) in;
layout(rgba32f) uniform readonly image2D first;
layout(rgba32f) uniform writeonly image2D result;
layout(r32f) uniform readonly image2D never;
uniform sampler2D second;
uniform sampler2D others[2];
layout(std430) readonly buffer ScaleOf { float scales[]; };
layout(std140) uniform Shift {
    int rows;  // of shifts
    vec3 unused_too;
    float whole;
    vec2 shifts[2];
};
uniform float gain, unused;
uniform vec2 parts[3];  // of which two are used
void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(result)))) return;
    vec4 sum = imageLoad(first, pixel) + 10.0 * texelFetch(second, pixel, 0)
             + 100.0 * texelFetch(others[0], pixel, 0) + 1000.0 * texelFetch(others[1], pixel, 0);
    imageStore(result, pixel, gain * scales[1] * sum + parts[0].x + parts[1].y
                              + whole + float(rows) * shifts[1].y + unused_too.z);
}
"""
SIZE = (6, 5)


def compiled(ctx, body):
    text = HEAD + body
    origin = tuple(("sum.glsl", number) for number in range(1, len(text.splitlines()) + 1))
    return Shader.of(ctx, ShaderSource(text, origin))


class Sum(Pass):
    """The shader above, and what it takes."""

    def __init__(self, ctx):
        super().__init__(ctx)
        self.shader = compiled(ctx, SUM)
        self._shaders.append(self.shader)
        self.given = {
            name: self._filled(value)
            for name, value in (("first", 1.0), ("second", 2.0), ("a", 3.0), ("b", 4.0))
        }
        self.given["others"] = [self.given.pop("a"), self.given.pop("b")]
        self.given["result"] = self._texture(SIZE, "rgba32f")
        self.given["scale_of"] = self._buffer(np.array([7, 0.5], np.float32).tobytes())
        self.shader["rows"] = 2
        self.shader["unused_too"] = 0, 0, 0.25
        self.shader["whole"] = -1
        self.shader["shifts"] = [(7, 8), (9, 0.5)]
        self.shader["gain"] = 2.0
        self.shader["parts"] = np.array([[1, 9], [9, 2], [5, 5]], np.float32)

    def _filled(self, value):
        texture = texture_from(
            self._ctx, np.full((SIZE[1], SIZE[0], 4), value, np.float32), "rgba32f"
        )
        self._textures.append(texture)
        return texture


@pytest.fixture
def summed(gl_context):
    made = Sum(gl_context)
    yield made
    made.release()


def test_every_resource_reaches_the_place_of_its_name(summed):
    summed.shader.run_over(SIZE, **summed.given)

    # The textures make 4321, the gain and the scale 1, and 3.25 is added.
    np.testing.assert_array_equal(read_back(summed.given["result"]), 4324.25)


def test_work_groups_are_as_large_as_the_source_says(summed):
    assert summed.shader.group == (4, 4)


def test_what_is_held_need_not_be_given(summed):
    summed._hold(**summed.given)
    summed.shader.run_over(SIZE, second=summed.given["first"])
    once = read_back(summed.given["result"])
    summed.shader.run_over(SIZE)

    np.testing.assert_array_equal(once, 4314.25)
    np.testing.assert_array_equal(read_back(summed.given["result"]), 4324.25)


@pytest.mark.parametrize("left_out", ["first", "second", "others", "scale_of", "result"])
def test_a_resource_that_is_missing_is_named(summed, left_out):
    del summed.given[left_out]

    with pytest.raises(ShaderError, match=rf"sum\.glsl: \w+ '{left_out}' is not given"):
        summed.shader.run_over(SIZE, **summed.given)


def test_a_name_that_the_source_does_not_declare_is_refused(summed):
    with pytest.raises(ShaderError, match=r"no 'secnod' .*second"):
        summed.shader.run_over(SIZE, secnod=summed.given["second"], **summed.given)
    with pytest.raises(ShaderError, match="no 'gian'"):
        summed.shader["gian"] = 1.0
    with pytest.raises(ShaderError, match="no 'thrid'"):
        summed.shader.hold(thrid=summed.given["first"])


def test_what_the_driver_left_out_is_taken_and_ignored(summed):
    summed.shader["unused"] = 3.0
    summed.shader.run_over(SIZE, never=summed.given["first"], **summed.given)

    assert "never" not in summed.shader
    assert "scale_of" in summed.shader
    np.testing.assert_array_equal(read_back(summed.given["result"]), 4324.25)


def test_a_texture_of_another_format_is_refused(gl_context, summed):
    summed.given["first"] = wrong = create_texture(gl_context, SIZE, "rgba8")

    with pytest.raises(ShaderError, match=r"'first' is rgba32f .*of rgba8"):
        summed.shader.run_over(SIZE, **summed.given)
    wrong.release()


def test_a_buffer_in_a_texture_s_place_is_refused(summed):
    summed.given["second"] = summed.given["scale_of"]

    with pytest.raises(ShaderError, match="sampler 'second' cannot be a Buffer"):
        summed.shader.run_over(SIZE, **summed.given)


def test_an_image_that_branches_declare_differently_is_bound_for_both(gl_context):
    body = """
    layout(local_size_x = 1) in;
    #define WRITE 1
    #if WRITE
    layout(r32f) uniform writeonly image2D target;
    #else
    layout(r32f) uniform readonly image2D target;
    #endif
    void main() { imageStore(target, ivec2(0), vec4(3.0)); }
    """
    shader, target = compiled(gl_context, body), create_texture(gl_context, (1, 1), "r32f")
    shader.run(target=target)

    assert read_back(target) == 3
    shader.release()
    target.release()


def test_a_pass_tells_what_it_holds_and_frees_it(gl_context):
    class Outer(Pass):
        def __init__(self, ctx):
            super().__init__(ctx)
            self._texture((4, 2), "rgba32f")
            self._array((3, 2), 5, "r32f")
            self._buffer(100)
            self._part(Sum(ctx))

    outer = Outer(gl_context)
    inner = 5 * 16 * 30 + 8

    assert outer.held_bytes == 16 * 8 + 4 * 6 * 5 + 100 + inner
    outer.release()
    assert outer.held_bytes == 0


def test_images_of_integers_are_told_apart_too(gl_context):
    body = """
    layout(local_size_x = 1) in;
    layout(rgba32i) uniform readonly iimage2D signed_ones;
    layout(rg32ui) uniform readonly uimage2D whole_ones;
    layout(rgba32f) uniform readonly image2D ones;
    layout(rgba32f) uniform writeonly image2D target;
    void main() {
        ivec2 at = ivec2(0);
        imageStore(target, at, vec4(imageLoad(signed_ones, at).r, imageLoad(whole_ones, at).g,
                                    imageLoad(ones, at).b, 4.0));
    }
    """
    shader, target = compiled(gl_context, body), create_texture(gl_context, (1, 1), "rgba32f")
    given = {
        "signed_ones": texture_from(gl_context, np.full((1, 1, 4), -7, np.int32), "rgba32i"),
        "whole_ones": texture_from(gl_context, np.array([[[5, 8]]], np.uint32), "rg32ui"),
        "ones": texture_from(gl_context, np.full((1, 1, 4), 0.5, np.float32), "rgba32f"),
    }
    shader.run(target=target, **given)

    assert read_back(target).ravel().tolist() == [-7, 8, 0.5, 4]
    for item in (shader, target, *given.values()):
        item.release()


def test_layers_are_bound_as_one_image(gl_context):
    body = """
    layout(local_size_x = 1) in;
    layout(r32f) uniform writeonly image2DArray target;
    void main() { for (int k = 0; k < 3; ++k) imageStore(target, ivec3(0, 0, k), vec4(k)); }
    """
    shader = compiled(gl_context, body)
    target = create_texture_array(gl_context, (1, 1), 3, "r32f")
    shader.run(target=target)

    assert np.frombuffer(target.read(), np.float32).tolist() == [0, 1, 2]
    shader.release()
    target.release()


BOUND = """
layout(local_size_x = 1) in;
uniform sampler2D others[3];
layout(rgba32f) uniform image2D first, second;
void main() {
    vec4 sum = texelFetch(others[0], ivec2(0), 0) + imageLoad(first, ivec2(0));
    imageStore(second, ivec2(0), sum + texelFetch(others[2], ivec2(0), 0));
}
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="reads Linux's own figures")
def test_what_is_released_while_it_is_bound_is_freed_by_let_go(gl_context):
    if "llvmpipe" not in gl_context.info["GL_RENDERER"]:
        pytest.skip("a graphics card holds textures in its own memory")

    def held_mb():
        ctypes.CDLL(None).malloc_trim(0)  # or what was freed among other blocks counts as held
        return 1.024e-3 * int(STATUS.read_text(encoding="ascii").split("RssAnon:")[1].split()[0])

    pixels = np.ones((1200, 2048, 4), np.float32)  # 39 MB
    small, *large = (
        texture_from(gl_context, part, "rgba32f") for part in (pixels[:8], *[pixels] * 3)
    )
    shader = compiled(gl_context, BOUND)
    shader.run(others=(small, small, large[0]), first=large[1], second=large[2])
    del pixels
    gc.collect()
    bound_mb = held_mb()
    for one in (small, *large, shader):
        one.release()
    let_go(gl_context)
    assert held_mb() < bound_mb - 100
