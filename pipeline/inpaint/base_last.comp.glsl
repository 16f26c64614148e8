#version 430
// Last push of the base: the colour of every hole pixel, in place.
// Twin: guided_base() and push() in reference.py. Change both or neither.

#include "tiles.glsl"
#include "guided.glsl"

layout(rgba32f, binding = 0) uniform image2D image;  // rgb: encoded colour; a: 1 known, 0 hole
layout(r32f, binding = 1) uniform readonly image2D depth_m;
layout(rgba32f, binding = 2) uniform readonly image2D coarse;  // complete
layout(r32f, binding = 3) uniform readonly image2D coarse_guide;

uniform float z_near_m;

// Completes one pixel from its parent `a` and the next ones on its side: `b` in x, `c` in y.
void complete(ivec2 pixel, ivec2 a, ivec2 d) {
    if (imageLoad(image, pixel).a >= 0.5) return;
    float guide = max(0.0, 1.0 - z_near_m / imageLoad(depth_m, pixel).r);
    ivec2 b = ivec2(d.x, a.y);
    ivec2 c = ivec2(a.x, d.y);
    vec4 share = push_shares(guide, vec4(imageLoad(coarse_guide, a).r, imageLoad(coarse_guide, b).r,
                                         imageLoad(coarse_guide, c).r,
                                         imageLoad(coarse_guide, d).r));
    vec3 colour = mixed(share, imageLoad(coarse, a), imageLoad(coarse, b), imageLoad(coarse, c),
                        imageLoad(coarse, d)).rgb;
    // A convex combination, but for rounding.
    imageStore(image, pixel, vec4(clamp(colour, 0.0, 1.0), 0.0));
}

// `parent` is a pixel of resolution 1; its four children are completed.
void work(ivec2 parent) {
    // A parent without a hole child has nothing to do, and knows it.
    if (imageLoad(coarse, parent).w >= 1.0) return;
    ivec2 size = imageSize(image);
    ivec2 before = max(parent - 1, ivec2(0));
    ivec2 after = min(parent + 1, work_size - 1);
    ivec2 pixel = 2 * parent;
    bvec2 whole = lessThan(pixel + 1, size);
    complete(pixel, parent, before);
    if (whole.x) complete(pixel + ivec2(1, 0), parent, ivec2(after.x, before.y));
    if (whole.y) complete(pixel + ivec2(0, 1), parent, ivec2(before.x, after.y));
    if (all(whole)) complete(pixel + 1, parent, after);
}
