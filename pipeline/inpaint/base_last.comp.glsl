#version 430
// Last push of the base: the colour of every hole pixel, in place.
// Twin: guided_base() and push() in reference.py. Change both or neither.

#include "tiles.glsl"
#include "guided.glsl"

layout(rgba32f, binding = 0) uniform image2D image;  // rgb: encoded colour; a: 1 known, 0 hole
layout(r32f, binding = 1) uniform readonly image2D depth_m;
layout(std430, binding = 4) readonly buffer Coarse { vec4 coarse[]; };  // complete
layout(std430, binding = 6) readonly buffer CoarseGuide { float coarse_guide[]; };

uniform float z_near_m;
uniform ivec2 coarse_size;

void work(ivec2 pixel) {
    if (imageLoad(image, pixel).a >= 0.5) return;
    float guide = max(0.0, 1.0 - z_near_m / imageLoad(depth_m, pixel).r);
    ivec2 near = pixel >> 1;
    ivec2 far = clamp(near + 2 * (pixel & 1) - 1, ivec2(0), coarse_size - 1);
    int a = near.y * coarse_size.x + near.x;
    int b = near.y * coarse_size.x + far.x;
    int c = far.y * coarse_size.x + near.x;
    int d = far.y * coarse_size.x + far.x;
    vec4 share = push_shares(guide, vec4(coarse_guide[a], coarse_guide[b], coarse_guide[c],
                                         coarse_guide[d]));
    vec3 colour = mixed(share, coarse[a], coarse[b], coarse[c], coarse[d]).rgb;
    // A convex combination, but for rounding.
    imageStore(image, pixel, vec4(clamp(colour, 0.0, 1.0), 0.0));
}
