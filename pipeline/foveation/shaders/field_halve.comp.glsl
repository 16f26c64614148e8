#version 430
// A resolution of a field's noise, halved. Twin: chain_of() in chain.py. Change both or neither.

#constant TILE  // work-group edge, texels

#include "lowpass.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform sampler2D fine;
layout(rg32f) uniform writeonly image2D coarse;

void main() {
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy), size = textureSize(fine, 0);
    if (any(greaterThanEqual(texel, imageSize(coarse)))) return;
    ivec4 x = neighbours(2 * texel.x - 1, size.x, false), y = neighbours(2 * texel.y - 1, size.y, false);
    vec4 sum = vec4(0.0);
    for (int row = 0; row < 4; ++row) {
        vec4 a = texelFetch(fine, ivec2(x[0], y[row]), 0), b = texelFetch(fine, ivec2(x[1], y[row]), 0);
        vec4 c = texelFetch(fine, ivec2(x[2], y[row]), 0), d = texelFetch(fine, ivec2(x[3], y[row]), 0);
        sum += row % 3 == 0 ? low_outer(a, b, c, d) : low_inner(a, b, c, d);
    }
    imageStore(coarse, texel, sum);
}
