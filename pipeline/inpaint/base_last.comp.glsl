#version 430
// Last push of the base: the colour of every hole pixel, in place.
// Twin: guided_base() and push() in reference.py. Change both or neither.

#include "tiles.glsl"
#include "guided.glsl"

layout(rgba32f, binding = 0) uniform image2D image;  // rgb: encoded colour; a: 1 known, 0 hole
layout(binding = 0) uniform sampler2DArray coarse;   // complete
layout(binding = 1) uniform sampler2D depth_m;

uniform float z_near_m;
uniform ivec2 coarse_size;

void work(ivec2 pixel) {
    if (imageLoad(image, pixel).a >= 0.5) return;
    float guide = max(0.0, 1.0 - z_near_m / texelFetch(depth_m, pixel, 0).r);
    ivec2 a = pixel >> 1;
    ivec2 d = clamp(a + 2 * (pixel & 1) - 1, ivec2(0), coarse_size - 1);
    ivec2 b = ivec2(d.x, a.y);
    ivec2 c = ivec2(a.x, d.y);
    vec4 share = push_shares(guide, vec4(texelFetch(coarse, ivec3(a, 1), 0).w,
                                         texelFetch(coarse, ivec3(b, 1), 0).w,
                                         texelFetch(coarse, ivec3(c, 1), 0).w,
                                         texelFetch(coarse, ivec3(d, 1), 0).w));
    vec3 colour = mixed(share, texelFetch(coarse, ivec3(a, 0), 0),
                        texelFetch(coarse, ivec3(b, 0), 0), texelFetch(coarse, ivec3(c, 0), 0),
                        texelFetch(coarse, ivec3(d, 0), 0)).rgb;
    // A convex combination, but for rounding.
    imageStore(image, pixel, vec4(clamp(colour, 0.0, 1.0), 0.0));
}
