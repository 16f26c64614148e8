#version 430
// Push: complete one resolution of one or more chains, in place.
// Twin: push() in reference.py. Change both or neither.

#constant PLANES
#constant MOST_CHAINS

#include "tiles.glsl"
#include "guided.glsl"
#include "chains.glsl"

layout(rgba32f, binding = 0) uniform image2D fine;
layout(rgba32f, binding = 1) uniform readonly image2D coarse;  // complete
layout(r32f, binding = 2) uniform readonly image2D fine_guide;
layout(r32f, binding = 3) uniform readonly image2D coarse_guide;

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
    vec4 share = push_shares(imageLoad(fine_guide, pixel).r,
                             vec4(imageLoad(coarse_guide, a).r, imageLoad(coarse_guide, b).r,
                                  imageLoad(coarse_guide, c).r, imageLoad(coarse_guide, d).r));
    for (int chain = 0; chain < chains; ++chain) {
        ivec2 to = texel_at(pixel, chain, work_size);
        float validity = is_active(fine_first[chain], fine_columns, pixel / TILE)
                             ? imageLoad(fine, to).w
                             : 0.0;
        if (validity >= 1.0) continue;
        float keep = kept(validity, gamma);
        ivec2 from_a = texel_at(a, chain, coarse_size), from_b = texel_at(b, chain, coarse_size);
        ivec2 from_c = texel_at(c, chain, coarse_size), from_d = texel_at(d, chain, coarse_size);
        for (int plane = 0; plane < PLANES; ++plane) {
            ivec2 next = ivec2(plane, 0);
            vec4 below = mixed(share, imageLoad(coarse, from_a + next),
                               imageLoad(coarse, from_b + next), imageLoad(coarse, from_c + next),
                               imageLoad(coarse, from_d + next));
            vec4 texel = (1.0 - keep) * below;
            if (keep > 0.0) texel += keep * imageLoad(fine, to + next);
            if (plane == 0) texel.w = validity;
            imageStore(fine, to + next, texel);
        }
    }
}
