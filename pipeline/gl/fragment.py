"""Compute shaders as fragment shaders of WebGL2, which has no others.

A compute shader writes pixels of pictures. Each picture that it writes becomes one fragment shader,
whose pixel does all that its call does, and keeps what is written to itself: a call that makes 2x2
pixels is done four times. So a page draws with the very shaders that are held to their twins.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from pipeline.gl.shader import ShaderSource

_LOCAL_SIZE = re.compile(r"^layout\(local_size_x.*$", re.MULTILINE)
_IMAGE = re.compile(r"layout\(\w+\) uniform writeonly ([iu]?)image2D(Array)? (\w+);")

_PRELUDE = """#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler2DArray;
precision highp isampler2D;
precision highp usampler2DArray;
OUTPUTS
#define CALL uvec3(uvec2(gl_FragCoord.xy) / SHAREu, 0u)
#define PASS_OVER(at, value)
struct Four { ivec2 first, last; vec2 part; };
Four four_at(vec2 at, ivec2 size) {
    vec2 place = at * vec2(size) - 0.5, corner = floor(place);
    ivec2 first = ivec2(corner), last = size - 1;
    return Four(clamp(first, ivec2(0), last), clamp(first + 1, ivec2(0), last), place - corner);
}
vec4 between(sampler2D image, vec2 at) {
    Four f = four_at(at, textureSize(image, 0));
    vec4 a = texelFetch(image, f.first, 0), b = texelFetch(image, ivec2(f.last.x, f.first.y), 0);
    vec4 c = texelFetch(image, ivec2(f.first.x, f.last.y), 0), d = texelFetch(image, f.last, 0);
    return mix(mix(a, b, f.part.x), mix(c, d, f.part.x), f.part.y);
}
struct Texels { vec4 a, b, c, d; };
Texels texels_of(sampler2DArray image, Four f, int z) {
    return Texels(texelFetch(image, ivec3(f.first, z), 0),
                  texelFetch(image, ivec3(f.last.x, f.first.y, z), 0),
                  texelFetch(image, ivec3(f.first.x, f.last.y, z), 0),
                  texelFetch(image, ivec3(f.last, z), 0));
}
vec4 between(sampler2DArray image, vec3 at) {
    Four f = four_at(at.xy, textureSize(image, 0).xy);
    Texels t = texels_of(image, f, int(at.z));
    return mix(mix(t.a, t.b, f.part.x), mix(t.c, t.d, f.part.x), f.part.y);
}
vec4 gathered(sampler2DArray image, vec3 at, int channel) {
    Texels t = texels_of(image, four_at(at.xy, textureSize(image, 0).xy), int(at.z));
    return vec4(t.c[channel], t.d[channel], t.b[channel], t.a[channel]);
}
"""
"""Textures of floats are interpolated here: few telephones do it."""
_ONE = """layout(location = 0) out KIND pixel_kept;
void keep(ivec2 at, KIND value) { if (at == ivec2(gl_FragCoord.xy)) pixel_kept = value; }
"""
_LAYERS = """layout(location = 0) out KIND kept_0;
layout(location = 1) out KIND kept_1;
layout(location = 2) out KIND kept_2;
layout(location = 3) out KIND kept_3;
uniform int layer_kept;
void keep(ivec3 at, KIND value) {
    if (at.xy != ivec2(gl_FragCoord.xy)) return;
    if (at.z == layer_kept) kept_0 = value;
    if (at.z == layer_kept + 1) kept_1 = value;
    if (at.z == layer_kept + 2) kept_2 = value;
    if (at.z == layer_kept + 3) kept_3 = value;
}
"""


def fragment_of(
    source: ShaderSource,
    image: str,
    *,
    shared: int = 1,
    known: Mapping[str, list[int]] | None = None,
) -> str:
    """Return the fragment shader that draws one picture of a compute shader.

    Parameters
    ----------
    source : ShaderSource
        A compute shader that shares nothing between its calls.
    image : str
        The picture, by its name there. Of an array four layers are drawn at a time, from
        `layer_kept` on.
    shared : int
        Pixels along an axis that a call makes of it.
    known : mapping, optional
        Arrays of whole numbers that become constants: telephones have few uniforms.
    """
    text = source.text.split("\n", 1)[1]
    sign, array = next((sign, array) for sign, array, name in _IMAGE.findall(text) if name == image)
    text = _IMAGE.sub(lambda m: f"uniform ivec{3 if m[2] else 2} {m[3]}_size;", text)
    text = _LOCAL_SIZE.sub("", text)
    text = re.sub(r"\bimageSize\((\w+)\)", r"\1_size", text)
    text = re.sub(
        r"\bimageStore\((\w+), ", lambda m: "keep(" if m[1] == image else "PASS_OVER(", text
    )
    for name, numbers in (known or {}).items():
        words = ", ".join(map(str, numbers))
        text = re.sub(
            rf"uniform int {name}\[[^\]]*\];", f"const int {name}[] = int[]({words});", text
        )
    for word, mine in (
        ("gl_GlobalInvocationID", "CALL"), ("textureLod", "LOD"), ("textureGather", "gathered"),
    ):  # fmt: skip
        text = re.sub(rf"\b{word}\b", mine, text)
    prelude = _PRELUDE.replace("OUTPUTS", _LAYERS if array else _ONE)
    prelude = prelude.replace("KIND", f"{sign}vec4").replace("SHARE", str(shared))
    return prelude + "#define LOD(image, at, level) between(image, at)\n" + text
