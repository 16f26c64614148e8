#version 430
// Pull: one resolution of one or more chains into the next coarser one.
// Twin: pull() in reference.py. Change both or neither.

#constant IS_BASE      // 1: the one chain of colour, which also pulls the guide for all
#constant PLANES
#constant MOST_CHAINS

#include "active.glsl"
#include "tiles.glsl"
#include "guided.glsl"

layout(std430, binding = 4) readonly buffer Fine { vec4 fine[]; };
layout(std430, binding = 5) writeonly buffer Coarse { vec4 coarse[]; };
layout(std430, binding = 6) readonly buffer FineGuide { float fine_guide[]; };
#if IS_BASE
layout(std430, binding = 7) writeonly buffer CoarseGuide { float coarse_guide[]; };
#else
layout(std430, binding = 7) readonly buffer CoarseGuide { float coarse_guide[]; };
#endif

uniform ivec2 fine_size;
uniform uint fine_columns;                // tiles per row
uniform uint fine_first[MOST_CHAINS];     // where a chain's active tiles start
uniform uint coarse_columns;
uniform uint coarse_first[MOST_CHAINS];
uniform int chains;
uniform uvec2 incomplete_list;  // index and first entry: what push has to complete

void work(ivec2 pixel) {
    ivec2 near = 2 * pixel;
    ivec2 far = min(near + 1, fine_size - 1);
    int a = near.y * fine_size.x + near.x;
    int b = near.y * fine_size.x + far.x;
    int c = far.y * fine_size.x + near.x;
    int d = far.y * fine_size.x + far.x;
    int place = pixel.y * work_size.x + pixel.x;
#if !IS_BASE
    float deepest = coarse_guide[place];
#endif
    bool complete = true;
    for (int chain = 0; chain < chains; ++chain) {
        if (!is_active(coarse_first[chain], coarse_columns, pixel / TILE)) {
            complete = false;
            continue;
        }
        vec4 validity = vec4(0.0);
        vec4 guide = vec4(0.0);
        int base = chain * fine_size.x * fine_size.y;
        int from_a = (base + a) * PLANES, from_b = (base + b) * PLANES;
        int from_c = (base + c) * PLANES, from_d = (base + d) * PLANES;
        // All four children lie in one tile: tiles have even edges.
        if (is_active(fine_first[chain], fine_columns, near / TILE)) {
            validity = vec4(fine[from_a].w, fine[from_b].w, fine[from_c].w, fine[from_d].w);
            guide = vec4(fine_guide[a], fine_guide[b], fine_guide[c], fine_guide[d]);
        }
#if IS_BASE
        float deepest = farthest(guide);
        coarse_guide[place] = deepest;
#endif
        Pull p = pull_shares(validity, guide, deepest);
        int to = (chain * work_size.x * work_size.y + place) * PLANES;
        for (int plane = 0; plane < PLANES; ++plane) {
            vec4 parent = vec4(0.0);
            if (p.confidence != 0.0) {
                parent = mixed(p.share, fine[from_a + plane], fine[from_b + plane],
                               fine[from_c + plane], fine[from_d + plane]);
            }
            if (plane == 0) parent.w = p.confidence;
            coarse[to + plane] = parent;
        }
        complete = complete && p.confidence >= 1.0;
    }
    if (!complete) append(incomplete_list.x, incomplete_list.y, pixel);
}
