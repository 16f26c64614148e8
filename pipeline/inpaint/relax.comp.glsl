#version 430
// Half a relaxation of the base, in place: pixels whose row and column add up to an even or an odd
// number are drawn towards the mean of their four neighbours.
// Twin: relax() in reference.py. Change both or neither.

#constant IS_FINEST  // 1: the frame itself, by 2x2; 0: a coarser resolution, by pixel
#constant GAMMA      // how much of itself an incomplete texel keeps, see kept()

#include "pixels.glsl"
#include "guided.glsl"

#if IS_FINEST
layout(rgba32f) uniform image2D level;  // rgb: encoded colour; a: 1 known, 0 hole
layout(r32f) uniform readonly image2D depth_m;

uniform float z_near_m;

float guide_at(ivec2 pixel) { return max(0.0, 1.0 - z_near_m / imageLoad(depth_m, pixel).r); }
#else
layout(rgba32f) uniform image2D level;  // a: validity
layout(r32f) uniform readonly image2D guide;

float guide_at(ivec2 pixel) { return imageLoad(guide, pixel).r; }
#endif

layout(std140) uniform Step { int parity; };

void relax(ivec2 pixel) {
    ivec2 last = imageSize(level) - 1;
    if (any(greaterThan(pixel, last))) return;
    vec4 own = imageLoad(level, pixel);
#if IS_FINEST
    if (own.a >= 0.5) return;
    float keep = 0.0;
#else
    float keep = kept(own.a, GAMMA, true);
#endif
    ivec2 before = max(pixel - 1, ivec2(0)), after = min(pixel + 1, last);
    ivec2 left = ivec2(before.x, pixel.y), right = ivec2(after.x, pixel.y);
    ivec2 above = ivec2(pixel.x, before.y), below = ivec2(pixel.x, after.y);
    vec4 guides = vec4(guide_at(left), guide_at(right), guide_at(above), guide_at(below));
    vec4 share = relax_shares(guide_at(pixel), guides);
    if (share == vec4(0.0)) return;
    vec3 mean = mixed(share, imageLoad(level, left), imageLoad(level, right),
                      imageLoad(level, above), imageLoad(level, below)).rgb;
    vec3 colour = keep * own.rgb + (1.0 - keep) * mean;
#if IS_FINEST
    colour = clamp(colour, 0.0, 1.0);  // a convex combination, but for rounding
#endif
    imageStore(level, pixel, vec4(colour, own.a));
}

void work(ivec2 place, int chain) {
#if IS_FINEST
    relax(2 * place + ivec2(parity, 0));
    relax(2 * place + ivec2(1 - parity, 1));
#else
    if (((place.x + place.y) & 1) == parity) relax(place);
#endif
}
