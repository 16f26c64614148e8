#version 430
// Pull: one resolution of one or more chains into the next coarser one.
// Twin: pull() in reference.py. Change both or neither.

#constant IS_BASE      // 1: the one chain of colour, which also pulls the guide for all
#constant MOST_CHAINS

#include "active.glsl"
#include "tiles.glsl"
#include "guided.glsl"
#include "taps.glsl"
#include "planes.glsl"

layout(rgba32f) uniform readonly image2D fine;
layout(rgba32f) uniform writeonly image2D coarse;
layout(r32f) uniform readonly image2D fine_guide;
#if IS_BASE
layout(r32f) uniform writeonly image2D coarse_guide;
#else
layout(r32f) uniform readonly image2D coarse_guide;
#endif

layout(std140) uniform Step {
    ivec2 fine_size;
    uvec2 incomplete_list;           // index and first entry: what push has to complete
    uvec3 fine_region[MOST_CHAINS];  // tiles of each chain that some pass has written
};

void work(ivec2 pixel, int chain) {
    Taps taps = children_of(pixel, fine_size);
    vec4 guide = GUIDES_AT(fine_guide, taps);
    // All four lie in one tile: tiles have even edges.
    bool some = is_active(fine_region[chain], taps.a);
    taps = texels_at(taps, chain, fine_size.y);
    vec4 a = imageLoad(fine, taps.a), b = imageLoad(fine, taps.b);
    vec4 c = imageLoad(fine, taps.c), d = imageLoad(fine, taps.d);
    vec4 validity = some ? vec4(a.w, b.w, c.w, d.w) : vec4(0.0);
#if IS_BASE
    if (!some) guide = vec4(0.0);
    float deepest = farthest(guide);
    imageStore(coarse_guide, pixel, vec4(deepest));
#else
    float deepest = imageLoad(coarse_guide, pixel).r;
#endif
    Pull p = pull_shares(validity, guide, deepest);
    bool anything = p.confidence != 0.0;  // what no pass has written may be no number
    ivec2 to = texel_at(pixel, chain, work_size.y);
    vec4 values = anything ? mixed(p.share, a, b, c, d) : vec4(0.0);
    imageStore(coarse, to, vec4(values.rgb, p.confidence));
#define PULL(offset)                                                       \
    values = anything ? MIXED_AT(fine, taps, p.share, offset) : vec4(0.0); \
    imageStore(coarse, to + offset, values);
    EACH_OTHER_PLANE(PULL)
    if (p.confidence < 1.0) append(incomplete_list.x, incomplete_list.y, pixel, chain);
}
