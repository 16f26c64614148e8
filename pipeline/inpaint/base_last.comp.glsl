#version 430
// Last push of the base: the colour of every hole pixel, in place.
// Twin: guided_base() and push() in reference.py. Change both or neither.

#include "pixels.glsl"
#include "guided.glsl"
#include "taps.glsl"

layout(rgba32f) uniform image2D image;  // rgb: encoded colour; a: 1 known, 0 hole
layout(r32f) uniform readonly image2D depth_m;
layout(rgba32f) uniform readonly image2D coarse;  // complete
layout(r32f) uniform readonly image2D coarse_guide;

uniform float z_near_m;

// Completes one pixel from its parent and the next texels on its side.
void complete(ivec2 pixel, ivec2 near, ivec2 far) {
    if (imageLoad(image, pixel).a >= 0.5) return;
    float guide = max(0.0, 1.0 - z_near_m / imageLoad(depth_m, pixel).r);
    Taps taps = taps_of(near, far);
    vec4 share = push_shares(guide, GUIDES_AT(coarse_guide, taps)).share;
    vec3 colour = MIXED_AT(coarse, taps, share, 0).rgb;
    // A convex combination, but for rounding.
    imageStore(image, pixel, vec4(clamp(colour, 0.0, 1.0), 0.0));
}

// `parent` is a pixel of resolution 1; its hole children are completed.
void work(ivec2 parent, int chain) {
    ivec2 before = max(parent - 1, ivec2(0));
    ivec2 after = min(parent + 1, work_size - 1);
    ivec2 pixel = 2 * parent;
    bvec2 whole = lessThan(pixel + 1, imageSize(image));
    complete(pixel, parent, before);
    if (whole.x) complete(pixel + ivec2(1, 0), parent, ivec2(after.x, before.y));
    if (whole.y) complete(pixel + ivec2(0, 1), parent, ivec2(before.x, after.y));
    if (all(whole)) complete(pixel + 1, parent, after);
}
