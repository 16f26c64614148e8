"""Draws what a flip shows, pixel by pixel: nothing is ever filtered or scaled.

Places are pixels from the upper left corner of the screen. Textures hold rows from the top.
"""

from __future__ import annotations

import moderngl
import numpy as np
from numpy.typing import NDArray

from study_app.desktop.strip import BLOCK_PX, BLOCKS, CRC_BITS, GUARD, NUMBER_BITS, code_of

VERTEX = """
#version 330
void main() {  // the whole viewport, as a strip of two triangles
    gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0, 0.0, 1.0);
}
"""
# Texel for pixel: texelFetch knows no filter. GL counts rows from below, images from above.
_LAYER = """
#version 330
uniform sampler2DArray clip;
uniform ivec2 corner;  // lower left pixel of the viewport
uniform int layer;
out vec4 colour;
void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy) - corner;
    int row = textureSize(clip, 0).y - 1 - pixel.y;
    colour = vec4(texelFetch(clip, ivec3(pixel.x, row, layer), 0).rgb, 1.0);
}
"""
_IMAGE = """
#version 330
uniform sampler2D image;
uniform ivec2 corner;
out vec4 colour;
void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy) - corner;
    colour = texelFetch(image, ivec2(pixel.x, textureSize(image, 0).y - 1 - pixel.y), 0);
}
"""
_STRIP = f"""
#version 330
uniform ivec2 corner;
uniform uint code;
out vec4 colour;
void main() {{
    int place = (int(gl_FragCoord.x) - corner.x) / {BLOCK_PX} - {len(GUARD)};
    uint bit = place < 0 ? uint(place == -{len(GUARD)})
                         : (code >> uint({NUMBER_BITS + CRC_BITS - 1} - place)) & 1u;
    colour = vec4(vec3(float(bit)), 1.0);
}}
"""


class Painter:
    """Draws into the window's back buffer.

    Parameters
    ----------
    ctx : moderngl.Context
        The window's.
    size : (width, height)
        Of the window, in pixels.
    background : int
        Grey around everything, 0 to 255.
    """

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], background: int) -> None:
        self._ctx, self._size = ctx, size
        self._grey = background / 255
        self._programs = [
            ctx.program(vertex_shader=VERTEX, fragment_shader=text)
            for text in (_LAYER, _IMAGE, _STRIP)
        ]
        layer, image, strip = self._programs
        self._layer, self._image, self._strip = (
            ctx.vertex_array(program, []) for program in self._programs
        )
        self._layer_corner, self._layer_index = (
            uniform_of(layer, "corner"),
            uniform_of(layer, "layer"),
        )
        self._image_corner = uniform_of(image, "corner")
        self._strip_corner, self._strip_code = (
            uniform_of(strip, "corner"),
            uniform_of(strip, "code"),
        )
        ctx.enable_only(moderngl.NOTHING)
        ctx.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA

    def clear(self) -> None:
        """Fill the screen with the background."""
        self._ctx.viewport = (0, 0, *self._size)
        self._ctx.clear(self._grey, self._grey, self._grey, 1.0)

    def clip_frame(
        self,
        clip: moderngl.TextureArray,
        layer: int,
        place: tuple[int, int],
        crop: tuple[int, int, int, int] | None = None,
    ) -> None:
        """Draw one layer of `clip`, or its `crop` (left, top, width, height), one to one.

        `place` is the upper left corner of what is drawn.
        """
        clip.use(0)
        left, top, width, height = crop or (0, 0, clip.width, clip.height)
        x, y = self._view(place, width, height)
        self._layer_corner.value = x - left, y - (clip.height - top - height)
        self._layer_index.value = layer
        self._layer.render(moderngl.TRIANGLE_STRIP, vertices=4)

    def fill(self, place: tuple[int, int], size: tuple[int, int], level: float) -> None:
        """Fill a rectangle; `level` from 0 (black) to 1 (white)."""
        (x, y), (width, height) = place, size
        self._ctx.scissor = (x, self._size[1] - y - height, width, height)
        self._ctx.clear(level, level, level, 1.0)
        self._ctx.scissor = None

    def image(self, texture: moderngl.Texture, place: tuple[int, int]) -> None:
        """Draw an RGBA image over what is there, one to one."""
        texture.use(0)
        self._image_corner.value = self._view(place, *texture.size)
        self._blend(self._image)

    def over(self, array: moderngl.VertexArray) -> None:
        """Draw a program of another's over the whole screen."""
        self._view((0, 0), *self._size)
        self._blend(array)

    def _blend(self, array: moderngl.VertexArray) -> None:
        self._ctx.enable(moderngl.BLEND)
        array.render(moderngl.TRIANGLE_STRIP, vertices=4)
        self._ctx.disable(moderngl.BLEND)

    def strip(self, number: int) -> None:
        """Draw the frame strip at the upper and at the lower edge."""
        self._strip_code.value = code_of(number)
        for top in (0, self._size[1] - BLOCK_PX):
            corner = self._view((0, top), BLOCKS * BLOCK_PX, BLOCK_PX)
            self._strip_corner.value = corner
            self._strip.render(moderngl.TRIANGLE_STRIP, vertices=4)

    def texture(self, image: NDArray[np.uint8]) -> moderngl.Texture:
        """Upload an image of shape (height, width, 4)."""
        height, width, _ = image.shape
        texture = self._ctx.texture((width, height), 4, np.ascontiguousarray(image).tobytes())
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return texture

    def finish(self) -> None:
        """Wait until everything asked for is drawn."""
        self._ctx.finish()

    def release(self) -> None:
        """Free programs and arrays."""
        for array in (self._layer, self._image, self._strip):
            array.release()
        for program in self._programs:
            program.release()

    def _view(self, place: tuple[int, int], width: int, height: int) -> tuple[int, int]:
        corner = place[0], self._size[1] - place[1] - height
        self._ctx.viewport = (*corner, width, height)
        return corner


def uniform_of(program: moderngl.Program, name: str) -> moderngl.Uniform:
    """Return a uniform that is in use."""
    uniform = program[name]
    assert isinstance(uniform, moderngl.Uniform), name
    return uniform
