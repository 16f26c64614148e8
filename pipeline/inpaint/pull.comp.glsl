#version 430
// Pull: one resolution of one or more chains into the next coarser one.
// Twin: pull() in reference.py. Change both or neither.

#constant IS_BASE      // 1: the one chain of colour, which also pulls the guide for all
#constant PLANES
#constant MOST_CHAINS

#include "tiles.glsl"
#include "guided.glsl"
#include "chains.glsl"

layout(rgba32f, binding = 0) uniform readonly image2D fine;
layout(rgba32f, binding = 1) uniform writeonly image2D coarse;
layout(r32f, binding = 2) uniform readonly image2D fine_guide;
#if IS_BASE
layout(r32f, binding = 3) uniform writeonly image2D coarse_guide;
#else
layout(r32f, binding = 3) uniform readonly image2D coarse_guide;
#endif

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
    float deepest = imageLoad(coarse_guide, pixel).r;
#endif
    for (int chain = 0; chain < chains; ++chain) {
        if (!is_active(coarse_first[chain], coarse_columns, pixel / TILE)) continue;
        vec4 validity = vec4(0.0);
        vec4 guide = vec4(0.0);
        ivec2 from_a = texel_at(a, chain, fine_size), from_b = texel_at(b, chain, fine_size);
        ivec2 from_c = texel_at(c, chain, fine_size), from_d = texel_at(d, chain, fine_size);
        // All four children lie in one tile: tiles have even edges.
        if (is_active(fine_first[chain], fine_columns, a / TILE)) {
            validity = vec4(imageLoad(fine, from_a).w, imageLoad(fine, from_b).w,
                            imageLoad(fine, from_c).w, imageLoad(fine, from_d).w);
            guide = vec4(imageLoad(fine_guide, a).r, imageLoad(fine_guide, b).r,
                         imageLoad(fine_guide, c).r, imageLoad(fine_guide, d).r);
        }
#if IS_BASE
        float deepest = farthest(guide);
        imageStore(coarse_guide, pixel, vec4(deepest));
#endif
        Pull p = pull_shares(validity, guide, deepest);
        ivec2 to = texel_at(pixel, chain, work_size);
        for (int plane = 0; plane < PLANES; ++plane) {
            ivec2 next = ivec2(plane, 0);
            vec4 parent = vec4(0.0);
            if (p.confidence != 0.0) {
                parent = mixed(p.share, imageLoad(fine, from_a + next),
                               imageLoad(fine, from_b + next), imageLoad(fine, from_c + next),
                               imageLoad(fine, from_d + next));
            }
            if (plane == 0) parent.w = p.confidence;
            imageStore(coarse, to + next, parent);
        }
    }
}
