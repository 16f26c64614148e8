#version 430
// Pull: one resolution of one or more chains into the next coarser one.
// Twin: pull() in reference.py. Change both or neither.

#constant IS_BASE      // 1: the chain of colour and motion, which holds the guide for all
#constant PLANES       // layers a chain
#constant MOST_CHAINS

#include "tiles.glsl"
#include "guided.glsl"

layout(binding = 0) uniform sampler2DArray fine;
layout(binding = 1) uniform sampler2DArray coarse_base;  // the base at the written resolution
layout(rgba32f, binding = 0) uniform writeonly image2DArray coarse;

uniform ivec2 fine_size;
uniform uint fine_columns;                // tiles per row
uniform uint fine_first[MOST_CHAINS];     // where a chain's active tiles start
uniform uint coarse_columns;
uniform uint coarse_first[MOST_CHAINS];
uniform int chains;

void work(ivec2 pixel) {
    ivec2 a = 2 * pixel;
    ivec2 d = min(a + 1, fine_size - 1);
    ivec2 b = ivec2(d.x, a.y);
    ivec2 c = ivec2(a.x, d.y);
#if !IS_BASE
    float deepest = texelFetch(coarse_base, ivec3(pixel, 1), 0).w;
#endif
    for (int chain = 0; chain < chains; ++chain) {
        if (!is_active(coarse_first[chain], coarse_columns, pixel / TILE)) continue;
        int layer = chain * PLANES;
        int last = layer + PLANES - 1;
        vec4 validity = vec4(0.0);
        vec4 guide = vec4(0.0);
        // All four children lie in one tile: tiles have even edges.
        bool known = is_active(fine_first[chain], fine_columns, a / TILE);
        if (known) {
            validity = vec4(texelFetch(fine, ivec3(a, layer), 0).w,
                            texelFetch(fine, ivec3(b, layer), 0).w,
                            texelFetch(fine, ivec3(c, layer), 0).w,
                            texelFetch(fine, ivec3(d, layer), 0).w);
            guide = vec4(texelFetch(fine, ivec3(a, last), 0).w,
                         texelFetch(fine, ivec3(b, last), 0).w,
                         texelFetch(fine, ivec3(c, last), 0).w,
                         texelFetch(fine, ivec3(d, last), 0).w);
        }
#if IS_BASE
        float deepest = farthest(guide);
#endif
        Pull p = pull_shares(validity, guide, deepest);
        for (int plane = layer; plane <= last; ++plane) {
            vec4 parent = vec4(0.0);
            if (p.confidence != 0.0) {
                parent = mixed(p.share, texelFetch(fine, ivec3(a, plane), 0),
                               texelFetch(fine, ivec3(b, plane), 0),
                               texelFetch(fine, ivec3(c, plane), 0),
                               texelFetch(fine, ivec3(d, plane), 0));
            }
            if (plane == layer) parent.w = p.confidence;
            if (plane == last) parent.w = deepest;
            imageStore(coarse, ivec3(pixel, plane), parent);
        }
    }
}
