#version 430
// First pull of the base: known colour and motion, 2x2 into one, with depth as the guide.
// Twin: guided_base() and pull() in reference.py. Change both or neither.

#include "tiles.glsl"
#include "guided.glsl"

layout(binding = 0) uniform sampler2D image;    // rgb: encoded colour; a: 1 known, 0 hole
layout(binding = 1) uniform sampler2D depth_m;  // r: metres, background's inside holes
layout(binding = 2) uniform sampler2D flow_px;  // rg: target minus source
layout(rgba32f, binding = 0) uniform writeonly image2DArray coarse;

uniform float z_near_m;

void work(ivec2 pixel) {
    ivec2 last = textureSize(image, 0) - 1;
    ivec2 a = 2 * pixel;
    ivec2 d = min(a + 1, last);
    ivec2 b = ivec2(d.x, a.y);
    ivec2 c = ivec2(a.x, d.y);
    vec4 colour_a = texelFetch(image, a, 0), colour_b = texelFetch(image, b, 0);
    vec4 colour_c = texelFetch(image, c, 0), colour_d = texelFetch(image, d, 0);
    vec4 validity = step(0.5, vec4(colour_a.a, colour_b.a, colour_c.a, colour_d.a));
    vec4 depth = vec4(texelFetch(depth_m, a, 0).r, texelFetch(depth_m, b, 0).r,
                      texelFetch(depth_m, c, 0).r, texelFetch(depth_m, d, 0).r);
    vec4 guide = max(vec4(0.0), 1.0 - z_near_m / depth);
    float deepest = farthest(guide);

    Pull p = pull_shares(validity, guide, deepest);
    vec3 colour = mixed(p.share, colour_a, colour_b, colour_c, colour_d).rgb;
    vec2 flow = mixed(p.share, texelFetch(flow_px, a, 0), texelFetch(flow_px, b, 0),
                      texelFetch(flow_px, c, 0), texelFetch(flow_px, d, 0)).rg;
    imageStore(coarse, ivec3(pixel, 0), vec4(colour, p.confidence));
    imageStore(coarse, ivec3(pixel, 1), vec4(flow, 0.0, deepest));
}
