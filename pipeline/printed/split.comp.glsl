#version 430
// Y'CbCr of what is known, and the depth that guides. Twin: printed_fill() in reference.py.
// Change both or neither.

#constant TILE  // work-group edge, pixels

layout(local_size_x = TILE, local_size_y = TILE) in;

#include "ycbcr.glsl"

layout(rgba32f) uniform readonly image2D image;  // encoded R'G'B'; a: 1 known
layout(r32f) uniform readonly image2D depth_m;
layout(rgba32f) uniform writeonly image2D low;   // Y'CbCr, 0 in holes; a: 1 known
layout(r32f) uniform writeonly image2D guide;    // 0 nearest, 1 at infinity
layout(rg32f) uniform writeonly image2D state;   // validity, guide

uniform float z_near_m;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(low)))) return;
    vec4 texel = imageLoad(image, pixel);
    vec3 ycbcr = YCBCR_FROM_RGB * texel.rgb;
    imageStore(low, pixel, texel.a > 0.0 ? vec4(ycbcr, 1.0) : vec4(0.0));
    float depth = max(0.0, 1.0 - z_near_m / imageLoad(depth_m, pixel).x);
    imageStore(guide, pixel, vec4(depth));
    imageStore(state, pixel, vec4(texel.a > 0.0 ? 1.0 : 0.0, depth, 0.0, 0.0));
}
