#version 430
// A level's bands and their squares, and where they are valid. With RESIDUAL, the low-pass itself,
// or what was pulled from colours where a hole or another depth would mix in.
// Twin: features(), residual_level() and printed_fill() in reference.py. Change both or neither.

#constant TILE      // work-group edge, pixels
#constant RESIDUAL  // 1: what is left after the last level, which has no bands

layout(local_size_x = TILE, local_size_y = TILE) in;

#include "bands.glsl"

layout(rgba32f) uniform readonly image2D low;  // Y'CbCr, 0 in holes; a: see halve
layout(r32f) uniform readonly image2D guide;
// Bands high, along x, along y side by side; squares below them.
layout(rgba32f) uniform writeonly image2D planes;
layout(rg32f) uniform writeonly image2D state;  // validity, guide

#if RESIDUAL
layout(rgba32f) uniform readonly image2D pulled;
layout(rg32f) uniform readonly image2D pulled_state;
#else
vec4 at(ivec2 pixel, ivec2 last) { return imageLoad(low, clamp(pixel, ivec2(0), last)); }

void put(ivec2 pixel, ivec2 size, int index, vec3 value) {
    imageStore(planes, pixel + ivec2(index * size.x, 0), vec4(value, 0.0));
    imageStore(planes, pixel + ivec2(index * size.x, size.y), vec4(value * value, 0.0));
}
#endif

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    ivec2 size = imageSize(low), last = size - 1;
    if (any(greaterThanEqual(pixel, size))) return;
#if RESIDUAL
    vec4 c = imageLoad(low, pixel);
    bool whole = c.a == 1.0;
    float valid = whole ? 1.0 : imageLoad(pulled_state, pixel).x;
    imageStore(planes, pixel, vec4(whole ? c.rgb : imageLoad(pulled, pixel).rgb, 0.0));
#else
    vec4 nw = at(pixel + ivec2(-1, -1), last), n = at(pixel + ivec2(0, -1), last);
    vec4 ne = at(pixel + ivec2(1, -1), last), w = at(pixel + ivec2(-1, 0), last);
    vec4 c = at(pixel, last), e = at(pixel + ivec2(1, 0), last);
    vec4 sw = at(pixel + ivec2(-1, 1), last), s = at(pixel + ivec2(0, 1), last);
    vec4 se = at(pixel + ivec2(1, 1), last);
    float valid = min(min(min(nw.a, n.a), min(ne.a, w.a)),
                      min(min(c.a, e.a), min(min(sw.a, s.a), se.a)));
    Bands bands = linear_bands(nw.rgb, n.rgb, ne.rgb, w.rgb, c.rgb, e.rgb,
                                 sw.rgb, s.rgb, se.rgb);
    put(pixel, size, 0, bands.high);
    put(pixel, size, 1, bands.along_x);
    put(pixel, size, 2, bands.along_y);
#endif
#if !RESIDUAL
    valid = valid == 1.0 ? 1.0 : 0.0;
#endif
    imageStore(state, pixel, vec4(valid, imageLoad(guide, pixel).x, 0.0, 0.0));
}
