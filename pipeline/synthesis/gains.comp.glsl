#version 430
// Spectral gains: by what to multiply the noise's deviations in each 4x4 pixels, so that its bands
// measure what they are asked for.
// Twin: variances_of_blocks() in reference.py, spectral_gains() in mixing.py. Change both or neither.

#constant LEVELS
#constant CHANNELS           // of noise: 1 or 3
#constant LEAST_GAIN         // no band is weakened to less,
#constant MOST_GAIN          // nor raised to more
#constant AIM                // over what a plane asks for
#constant UNSEEN_VARIANCE    // added to the variances asked for and measured
#constant SHARED_FROM_LEVEL  // from it on, single pixels beside show in the base:
#constant RESTLESS           // so much of the finest high band's variance, and a quarter per level
#constant UNEVEN             // of the second level's oriented bands' variance: in its high band

#include "pixels.glsl"
#include "guided.glsl"

// See composite.comp.glsl. w of the third texel: how far to heed the known background beside it.
layout(rgba32f, binding = 4) uniform readonly image2D variances;
layout(rgba32f, binding = 6) uniform writeonly image2D gains;

// What a level's three bands measure (rows) of products of deviations: of each two levels i <= j.
// See overlap_by_levels().
const int PAIRS = LEVELS * (LEVELS + 1) / 2;
layout(std140, binding = 0) uniform Overlap { mat4 overlap[LEVELS * PAIRS]; };

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

// Loops and arrays, unlike elsewhere: written out, the driver compiles for 10 to 30 s.
void store_gains(Lacking l, int channel, ivec2 to) {
    vec3 wanted[LEVELS];  // of the high band, the sum of the oriented ones, their difference
    for (int i = 0; i < LEVELS; ++i) {
        vec3 band = sqrt(vec3(l.high[i][channel], l.along_x[i][channel], l.along_y[i][channel]));
        wanted[i] = vec3(band.x, band.y + band.z, band.y - band.z);
    }
    float part = 1.0;  // of the finest high band's variance, in white noise
    int at = 0;
    for (int level = 0; level < LEVELS; ++level, part *= 0.25) {
        vec2 even = vec2(0.0);  // of the high band, and half the oriented ones' sum
        float odd = 0.0;        // half their difference
        for (int i = 0; i < LEVELS; ++i) {
            for (int j = i; j < LEVELS; ++j, ++at) {
                vec3 a = wanted[i], b = wanted[j];
                mat4 of = overlap[at];
                even += a.x * (b.x * of[0].xy + b.y * of[0].zw)
                      + a.y * (b.x * of[1].xy + b.y * of[1].zw) + (a.z * b.z) * of[2].xy;
                odd += dot(of[3], vec4(a.x * b.z, a.z * b.x, a.y * b.z, a.z * b.y));
            }
        }
        vec3 measured = vec3(even.x, even.y + odd, even.y - odd);
        measured = max(measured, vec3(0.0));
        if (level >= SHARED_FROM_LEVEL) {
            measured.yz += RESTLESS * part * l.heeded[level] * wanted[0].x * wanted[0].x;
        }
        vec3 asked = vec3(l.high[level][channel], l.along_x[level][channel], l.along_y[level][channel]);
        if (level == 1) measured.x += UNEVEN * 0.5 * (asked.y + asked.z);
        vec3 gain = sqrt((asked + UNSEEN_VARIANCE) / (measured + UNSEEN_VARIANCE));
        gain = AIM * clamp(gain, LEAST_GAIN, MOST_GAIN);
        imageStore(gains, to + ivec2(level, channel), vec4(gain, turn));
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
