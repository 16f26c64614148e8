"""Copies that no pass can do without: every input read once, every output written once."""

from __future__ import annotations

import moderngl

from pipeline.gl.compute import Shader
from pipeline.gl.shader import ShaderSource

_HEAD = "#version 430\nlayout(local_size_x = 8, local_size_y = 8) in;\n"


class Copy:
    """Copies textures of one size, one dispatch for all."""

    def __init__(self, ctx: moderngl.Context, *formats: str) -> None:
        images, body = [], []
        for k, name in enumerate(formats):
            images.append(f"layout({name}) uniform readonly image2D source_{k};\n")
            images.append(f"layout({name}) uniform writeonly image2D target_{k};\n")
            body.append(f"    imageStore(target_{k}, pixel, imageLoad(source_{k}, pixel));\n")
        text = (
            f"{_HEAD}{''.join(images)}"
            "void main() {\n"
            "    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);\n"
            "    if (any(greaterThanEqual(pixel, imageSize(target_0)))) return;\n"
            f"{''.join(body)}}}\n"
        )
        places = (("benchmarks/shared/copying.py", k) for k in range(1, text.count("\n") + 1))
        self._shader = Shader.of(ctx, ShaderSource(text, tuple(places)))

    def __call__(self, *pairs: tuple[moderngl.Texture, moderngl.Texture]) -> None:
        """Copy the first of each pair into the second."""
        given = {f"source_{k}": source for k, (source, _) in enumerate(pairs)}
        given |= {f"target_{k}": target for k, (_, target) in enumerate(pairs)}
        self._shader.run_over(pairs[0][1].size, **given)

    def release(self) -> None:
        """Free the shader."""
        self._shader.release()
