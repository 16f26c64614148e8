#version 430
// Push: complete one resolution of one or more chains, in place.
// Twin: push() in reference.py. Change both or neither.

#constant PLANES
#constant MOST_CHAINS
#constant TILE

#include "active.glsl"
#include "pixels.glsl"
#include "guided.glsl"

layout(std430, binding = 4) buffer Fine { vec4 fine[]; };
layout(std430, binding = 5) readonly buffer Coarse { vec4 coarse[]; };  // complete
layout(std430, binding = 6) readonly buffer FineGuide { float fine_guide[]; };
layout(std430, binding = 7) readonly buffer CoarseGuide { float coarse_guide[]; };

uniform float gamma;
uniform float behind;                  // see guided_shares
uniform ivec2 coarse_size;
uniform uint fine_columns;             // tiles per row
uniform uint fine_first[MOST_CHAINS];  // where a chain's active tiles start
uniform int first_chain;
uniform int end_chain;

void work(ivec2 pixel) {
    ivec2 near = pixel >> 1;
    ivec2 far = clamp(near + 2 * (pixel & 1) - 1, ivec2(0), coarse_size - 1);
    int a = near.y * coarse_size.x + near.x;
    int b = near.y * coarse_size.x + far.x;
    int c = far.y * coarse_size.x + near.x;
    int d = far.y * coarse_size.x + far.x;
    int place = pixel.y * work_size.x + pixel.x;
    Shares below = push_shares(fine_guide[place], vec4(coarse_guide[a], coarse_guide[b],
                                                     coarse_guide[c], coarse_guide[d]), behind);
    for (int chain = first_chain; chain < end_chain; ++chain) {
        int to = (chain * work_size.x * work_size.y + place) * PLANES;
        float validity =
            is_active(fine_first[chain], fine_columns, pixel / TILE) ? fine[to].w : 0.0;
        if (validity >= 1.0) continue;
        float keep = kept(validity, gamma, below.similar);
        int base = chain * coarse_size.x * coarse_size.y;
        int from_a = (base + a) * PLANES, from_b = (base + b) * PLANES;
        int from_c = (base + c) * PLANES, from_d = (base + d) * PLANES;
        for (int plane = 0; plane < PLANES; ++plane) {
            vec4 texel = (1.0 - keep) * mixed(below.share, coarse[from_a + plane],
                                              coarse[from_b + plane], coarse[from_c + plane],
                                              coarse[from_d + plane]);
            if (keep > 0.0) texel += keep * fine[to + plane];
            if (plane == 0) texel.w = validity;
            fine[to + plane] = texel;
        }
    }
}
