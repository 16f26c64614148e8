#version 430
// Spectral gains: by what to multiply the noise's deviations in each 4x4 pixels, so that its bands
// measure what they are asked for.
// Twin: variances_of_blocks() in reference.py, spectral_gains() in mixing.py. Change both or neither.

#constant CHANNELS           // of noise: 1 or 3
#constant SHARED_FROM_LEVEL  // from it on, single pixels beside show in the base:
#constant RESTLESS           // so much of the finest high band's variance, and a quarter per level

#include "pixels.glsl"
#include "guided.glsl"
#include "spectral_gains.glsl"

// See composite.comp.glsl. w of the third texel: how far to heed the known background beside it.
layout(rgba32f, binding = 4) uniform readonly image2D variances;
layout(rgba32f, binding = 6) uniform writeonly image2D gains;

uniform ivec4 level_size[LEVELS];  // columns, rows, where its first texel lies
uniform float turn;  // of calls: tells this one's gains from earlier ones

struct Texel {
    float guide;
    vec3 high, along_x, along_y;
    float heeded;
};

Texel variances_at(ivec2 place, ivec4 size) {
    place = clamp(place, ivec2(0), size.xy - 1);
    ivec2 at = ivec2(3 * place.x, place.y) + size.zw;
    vec4 high = imageLoad(variances, at), along_y = imageLoad(variances, at + ivec2(2, 0));
    vec3 along_x = imageLoad(variances, at + ivec2(1, 0)).rgb;
    return Texel(high.w, high.rgb, along_x, along_y.rgb, along_y.w);
}

// A child without a hole pixel may have none in this frame, and does not count.
Texel child_at(ivec2 place, int holes) {
    if (holes == 0) return Texel(-1.0, vec3(0.0), vec3(0.0), vec3(0.0), 0.0);
    return variances_at(place, level_size[0]);
}

// Variance that each band and channel of the block lacks, per level.
struct Lacking {
    vec3 high[LEVELS], along_x[LEVELS], along_y[LEVELS];
    float heeded[LEVELS];
};

#define MIXED(name) (share.x * a.name + share.y * b.name + share.z * c.name + share.w * d.name)

void add_lacking(inout Lacking l, int level, vec4 share, Texel a, Texel b, Texel c, Texel d) {
    l.high[level] = MIXED(high);
    l.along_x[level] = MIXED(along_x);
    l.along_y[level] = MIXED(along_y);
    l.heeded[level] = MIXED(heeded);
}

void add_coarse(inout Lacking l, int level, ivec2 block, float guide) {
    ivec4 size = level_size[level];
    vec2 place = (vec2(block) + 0.5) / float(1 << (level - 1)) - 0.5;
    ivec2 corner = ivec2(floor(place));
    vec2 part = place - floor(place), rest = 1.0 - part;
    Texel a = variances_at(corner, size), b = variances_at(corner + ivec2(1, 0), size);
    Texel c = variances_at(corner + ivec2(0, 1), size), d = variances_at(corner + 1, size);
    vec4 share = vec4(rest.x * rest.y, part.x * rest.y, rest.x * part.y, part.x * part.y);
    vec4 guides = vec4(a.guide, b.guide, c.guide, d.guide);
    add_lacking(l, level, guided_shares(share, guide, guides, depth_threshold).share, a, b, c, d);
}

void store_gains(Lacking l, int channel, ivec2 to) {
    for (int i = 0; i < LEVELS; ++i) {
        want(i, vec3(l.high[i][channel], l.along_x[i][channel], l.along_y[i][channel]));
    }
    float part = 1.0;  // of the finest high band's variance, in white noise
    for (int level = 0; level < LEVELS; ++level, part *= 0.25) {
        vec3 measured = measured_at(level);
        if (level >= SHARED_FROM_LEVEL) {
            measured.yz += RESTLESS * part * l.heeded[level] * wanted[0].x * wanted[0].x;
        }
        vec3 asked = vec3(l.high[level][channel], l.along_x[level][channel], l.along_y[level][channel]);
        imageStore(gains, to + ivec2(level, channel), vec4(gain_of(level, asked, measured), turn));
    }
}

// `holes`: which children hold a hole pixel, see WorkLists.
void work(ivec2 block, int holes) {
    Lacking l;
    ivec2 child = 2 * block;
    Texel a = child_at(child, holes & 1), b = child_at(child + ivec2(1, 0), holes & 2);
    Texel c = child_at(child + ivec2(0, 1), holes & 4), d = child_at(child + 1, holes & 8);
    vec4 guides = vec4(a.guide, b.guide, c.guide, d.guide);
    float guide = farthest(guides);
    vec4 share = vec4(greaterThanEqual(guides, vec4(0.0)))
               * vec4(lessThanEqual(guide - guides, vec4(depth_threshold)));
    add_lacking(l, 0, share / dot(share, vec4(1.0)), a, b, c, d);
#if LEVELS > 1
    Texel own = variances_at(block, level_size[1]);
    add_lacking(l, 1, vec4(1.0, 0.0, 0.0, 0.0), own, own, own, own);
#endif
    for (int level = 2; level < LEVELS; ++level) add_coarse(l, level, block, guide);
    for (int channel = 0; channel < CHANNELS; ++channel) {
        store_gains(l, channel, block * ivec2(LEVELS, CHANNELS));
    }
}
