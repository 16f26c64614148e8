#version 430
// Push: complete one resolution of one or more chains, in place.
// Twin: push() in reference.py. Change both or neither.

#constant GAMMA  // how much of itself an incomplete texel keeps, see kept()

#include "pixels.glsl"
#include "guided.glsl"
#include "taps.glsl"
#include "planes.glsl"

layout(rgba32f) uniform image2D fine;
layout(rgba32f) uniform readonly image2D coarse;  // complete
layout(r32f) uniform readonly image2D fine_guide;
layout(r32f) uniform readonly image2D coarse_guide;

layout(std140) uniform Step { ivec2 coarse_size; };

void work(ivec2 pixel, int chain) {
    Taps taps = parents_of(pixel, coarse_size);
    Shares below = push_shares(imageLoad(fine_guide, pixel).r, GUIDES_AT(coarse_guide, taps));
    taps = texels_at(taps, chain, coarse_size.y);
    ivec2 to = texel_at(pixel, chain, work_size.y);
    vec4 own = imageLoad(fine, to);
    float keep = kept(own.w, GAMMA, below.similar);
    vec4 values = (1.0 - keep) * MIXED_AT(coarse, taps, below.share, 0) + keep * own;
    imageStore(fine, to, vec4(values.rgb, own.w));
#define PUSH(offset)                                                         \
    values = (1.0 - keep) * MIXED_AT(coarse, taps, below.share, offset)      \
           + keep * imageLoad(fine, to + offset);                            \
    imageStore(fine, to + offset, values);
    EACH_OTHER_PLANE(PUSH)
}
