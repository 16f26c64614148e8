#version 430
// First pull of the base: known colour, 2x2 into one, with depth as the guide.
// Twin: guided_base() and pull() in reference.py. Change both or neither.

#include "tiles.glsl"
#include "guided.glsl"

layout(rgba32f, binding = 0) uniform readonly image2D image;  // rgb: encoded; a: 1 known, 0 hole
layout(r32f, binding = 1) uniform readonly image2D depth_m;   // background's inside holes
layout(rgba32f, binding = 2) uniform writeonly image2D coarse;
layout(r32f, binding = 3) uniform writeonly image2D coarse_guide;

uniform float z_near_m;

void work(ivec2 pixel) {
    ivec2 last = imageSize(image) - 1;
    ivec2 a = 2 * pixel;
    ivec2 d = min(a + 1, last);
    ivec2 b = ivec2(d.x, a.y);
    ivec2 c = ivec2(a.x, d.y);
    vec4 colour_a = imageLoad(image, a), colour_b = imageLoad(image, b);
    vec4 colour_c = imageLoad(image, c), colour_d = imageLoad(image, d);
    vec4 validity = step(0.5, vec4(colour_a.a, colour_b.a, colour_c.a, colour_d.a));
    vec4 depth = vec4(imageLoad(depth_m, a).r, imageLoad(depth_m, b).r, imageLoad(depth_m, c).r,
                      imageLoad(depth_m, d).r);
    vec4 guide = max(vec4(0.0), 1.0 - z_near_m / depth);
    float deepest = farthest(guide);
    Pull p = pull_shares(validity, guide, deepest);
    vec4 parent = mixed(p.share, colour_a, colour_b, colour_c, colour_d);
    imageStore(coarse, pixel, vec4(parent.rgb, p.confidence));
    imageStore(coarse_guide, pixel, vec4(deepest));
}
