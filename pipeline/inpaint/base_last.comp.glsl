#version 430
// Last push of the base: the colour of every hole pixel, in place.
// Twin: guided_base() and push() in reference.py. Change both or neither.

#constant ANY_DEPTH_BEHIND

#include "pixels.glsl"
#include "guided.glsl"

layout(rgba32f, binding = 0) uniform image2D image;  // rgb: encoded colour; a: 1 known, 0 hole
layout(r32f, binding = 1) uniform readonly image2D depth_m;
layout(std430, binding = 4) readonly buffer Coarse { vec4 coarse[]; };  // complete
layout(std430, binding = 6) readonly buffer CoarseGuide { float coarse_guide[]; };

uniform float z_near_m;

// Completes one pixel from its parent and the next texels on its side.
void complete(ivec2 pixel, ivec2 near, ivec2 far) {
    if (imageLoad(image, pixel).a >= 0.5) return;
    float guide = max(0.0, 1.0 - z_near_m / imageLoad(depth_m, pixel).r);
    int a = near.y * work_size.x + near.x;
    int b = near.y * work_size.x + far.x;
    int c = far.y * work_size.x + near.x;
    int d = far.y * work_size.x + far.x;
    vec4 guides = vec4(coarse_guide[a], coarse_guide[b], coarse_guide[c], coarse_guide[d]);
    vec4 share = push_shares(guide, guides, ANY_DEPTH_BEHIND).share;
    vec3 colour = mixed(share, coarse[a], coarse[b], coarse[c], coarse[d]).rgb;
    // A convex combination, but for rounding.
    imageStore(image, pixel, vec4(clamp(colour, 0.0, 1.0), 0.0));
}

// `parent` is a pixel of resolution 1; its hole children are completed.
void work(ivec2 parent) {
    ivec2 before = max(parent - 1, ivec2(0));
    ivec2 after = min(parent + 1, work_size - 1);
    ivec2 pixel = 2 * parent;
    bvec2 whole = lessThan(pixel + 1, imageSize(image));
    complete(pixel, parent, before);
    if (whole.x) complete(pixel + ivec2(1, 0), parent, ivec2(after.x, before.y));
    if (whole.y) complete(pixel + ivec2(0, 1), parent, ivec2(before.x, after.y));
    if (all(whole)) complete(pixel + 1, parent, after);
}
