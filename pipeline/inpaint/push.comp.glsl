#version 430
// Push: complete one resolution of one or more chains, in place.
// Twin: push() in reference.py. Change both or neither.

#constant IS_BASE      // 1: the chain of colour and motion, which holds the guide for all
#constant PLANES       // layers a chain
#constant MOST_CHAINS

#include "tiles.glsl"
#include "guided.glsl"

layout(rgba32f, binding = 0) uniform image2DArray fine;
layout(binding = 0) uniform sampler2DArray coarse;     // complete
layout(binding = 1) uniform sampler2DArray fine_base;  // the base at the written resolution

uniform float gamma;
uniform ivec2 coarse_size;
uniform uint fine_columns;             // tiles per row
uniform uint fine_first[MOST_CHAINS];  // where a chain's active tiles start
uniform int chains;

void work(ivec2 pixel) {
    ivec2 a = pixel >> 1;
    ivec2 d = clamp(a + 2 * (pixel & 1) - 1, ivec2(0), coarse_size - 1);
    ivec2 b = ivec2(d.x, a.y);
    ivec2 c = ivec2(a.x, d.y);
    for (int chain = 0; chain < chains; ++chain) {
        int layer = chain * PLANES;
        int last = layer + PLANES - 1;
        float validity = is_active(fine_first[chain], fine_columns, pixel / TILE)
                             ? imageLoad(fine, ivec3(pixel, layer)).w
                             : 0.0;
        if (validity >= 1.0) continue;
#if IS_BASE
        float guide = imageLoad(fine, ivec3(pixel, last)).w;
#else
        float guide = texelFetch(fine_base, ivec3(pixel, 1), 0).w;
#endif
        vec4 share = push_shares(guide, vec4(texelFetch(coarse, ivec3(a, last), 0).w,
                                             texelFetch(coarse, ivec3(b, last), 0).w,
                                             texelFetch(coarse, ivec3(c, last), 0).w,
                                             texelFetch(coarse, ivec3(d, last), 0).w));
        float keep = kept(validity, gamma);
        for (int plane = layer; plane <= last; ++plane) {
            vec4 texel = (1.0 - keep) * mixed(share, texelFetch(coarse, ivec3(a, plane), 0),
                                              texelFetch(coarse, ivec3(b, plane), 0),
                                              texelFetch(coarse, ivec3(c, plane), 0),
                                              texelFetch(coarse, ivec3(d, plane), 0));
            if (keep > 0.0) texel += keep * imageLoad(fine, ivec3(pixel, plane));
            if (plane == layer) texel.w = validity;
            if (plane == last) texel.w = guide;
            imageStore(fine, ivec3(pixel, plane), texel);
        }
    }
}
