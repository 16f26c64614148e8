#version 430
// Gains: what each block of 4x4 pixels multiplies every band's noise by. A call makes 2x2 blocks, with
// one spectral gain: what bands measure of each other is most of the work.
// Twin: wanted_by_blocks() in pooled_moments.py, lost_noise() in reference.py. Change both or neither.

#constant TILE               // work-group edge, 2x2 blocks
#constant SMALLEST_VARIANCE  // added to what is divided by
#constant PARTNER_SHARE      // of the small pool beside, along each axis
#constant CHROMA             // 1: Cb and Cr go with luma; 0: none
#constant RESOLUTIONS        // whose moments are read: 2, where no other is there, or more
#constant LEAST_TIGHTNESS    // of colours, at least
#constant LEAST_SKEWED       // variance: what varies less is hardly skewed
#constant LEAST_BOUND        // variance: what varies less is hardly bound
#constant STRONGEST_SKEW     // a sixth of the skewness, at most

#include "pools.glsl"
#include "spectral_gains.glsl"
#include "ycbcr.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

// See weighed_noise.glsl.
layout(rgba16f) uniform writeonly image2DArray weights;
// Moments as pull.comp.glsl writes them, of resolutions 1 and 2; chosen, of the coarser ones: level k's
// at k + 1. The last push, to resolution 2, is done here. WebGL takes constant indices alone.
const int THIRD = min(2, RESOLUTIONS - 1);  // the index of resolution 3; there may be two alone
uniform sampler2DArray moments[RESOLUTIONS];  // from resolution 1 on
uniform sampler2DArray powers[THIRD];         // of colours, from resolution 2 on

vec3 variance_of(vec4 first, vec4 second) { return max(first.xyz - second.xyz * second.xyz, 0.0); }

// Weights of a block's noise, but for the gains, and what else is known of it. Room
// for the most levels, for indices written out: arrays that are indexed by a variable are slow.
struct Block { vec4 weights[6], scalars[3]; };

#define SCALAR(own, i) own.scalars[(i) / 4][(i) % 4]

// Value of the pool of a block in a layer of resolution 2, and in the same of the coarser one.
vec4 chosen(sampler2DArray own, sampler2DArray coarser, ivec2 block, vec2 within, int layer, float share) {
    vec4 found = texelFetch(own, ivec3(block, layer), 0);
    if (THIRD == 2) found = mix(found, textureLod(coarser, vec3(within, float(layer)), 0.0), share);
    return found;
}

#define POWERS(layer) chosen(powers[0], powers[THIRD - 1], block, within, layer, share)

struct Colours { vec2 chroma; vec4 shape; };

// Twin: colour_shape() in pooled_moments.py.
Colours colours_at(ivec2 block, vec2 within, float pool) {
    float share = beyond_lod(pool, 2);
    vec4 colours = POWERS(0), squares = POWERS(1), higher = POWERS(2);
    vec3 first = colours.xyz, second = squares.xyz, third = higher.xyz, squared = first * first;
    vec3 variance = max(second - squared, 0.0) + SMALLEST_VARIANCE;
    vec3 cube = third - 3.0 * first * second + 2.0 * first * squared;
    float quartic = higher.a - dot(4.0 * first * third - 6.0 * squared * second + 3.0 * squared * squared, vec3(1.0));
    float skewed = dot(3.0 * cube * cube / variance, vec3(1.0));
    float room = 6.0 * dot(variance, variance) + skewed - 2.0 * quartic;
    float whole = 4.0 * quartic - skewed + LEAST_BOUND * LEAST_BOUND;
    vec3 wide = variance + LEAST_SKEWED;
    vec3 skew = clamp(cube / (6.0 * wide * sqrt(wide)), -STRONGEST_SKEW, STRONGEST_SKEW);
    vec2 mean = (YCBCR_FROM_RGB * first).yz;
    return Colours(max(vec2(colours.a, squares.a) - mean * mean, 0.0) + SMALLEST_VARIANCE,
                   vec4(skew, clamp(room / whole, LEAST_TIGHTNESS, 1.0)));
}

vec2 slopes_of(vec4 first, vec4 second) {
    return float(CHROMA) * vec2(first.a, second.a) / (first.x + first.y + first.z + SMALLEST_VARIANCE);
}

// Of the finest level, where pools are smaller than a block.
vec3 with_small_pools(ivec2 block, vec3 wide, float pool) {
    float share = beyond_lod(pool, 1);
    if (share == 1.0) return wide;
    // Each of 2x2 is mixed with those beside it; see _widened().
    ivec2 near = 2 * block, far = min(near + 1, textureSize(moments[0], 0).xy - 1);
    const float own = (1.0 - PARTNER_SHARE) * (1.0 - PARTNER_SHARE);
    const float aside = PARTNER_SHARE * (1.0 - PARTNER_SHARE), across = PARTNER_SHARE * PARTNER_SHARE;
    const mat4 mixed = mat4(own, aside, aside, across, aside, own, across, aside,
                            aside, across, own, aside, across, aside, aside, own);
#define SMALL(layer)                                                                                \
    mat4x3(texelFetch(moments[0], ivec3(near, layer), 0).xyz,                                       \
           texelFetch(moments[0], ivec3(far.x, near.y, layer), 0).xyz,                              \
           texelFetch(moments[0], ivec3(near.x, far.y, layer), 0).xyz,                              \
           texelFetch(moments[0], ivec3(far, layer), 0).xyz) * mixed
    mat4x3 square = SMALL(0), mean = SMALL(1);
    vec3 fine = vec3(0.0);
    for (int i = 0; i < 4; ++i) fine += 0.25 * max(square[i] - mean[i] * mean[i], 0.0);
    return mix(fine, wide, share) + share * (1.0 - share) * max(wide - fine, 0.0);
}

// Moments of a level at a block's middle.
struct Moments { vec4 first, second; };

// Of the two finest levels: as they are chosen for resolution 2.
Moments near_moments(int level, ivec2 block, vec2 within, float pool) {
    float share = beyond_lod(pool * exp2(float(-2 * level)), 2 - level);
    return Moments(chosen(moments[1], moments[THIRD], block, within, 2 * level, share),
                   chosen(moments[1], moments[THIRD], block, within, 2 * level + 1, share));
}

// Of a coarser level, whose moments lie in the resolution `own`.
Moments far_moments(sampler2DArray own, int level, ivec2 block) {
    vec2 at = (vec2(block) + 0.5) / float(1 << (level - 1)) / vec2(textureSize(own, 0).xy);
    return Moments(textureLod(own, vec3(at, float(2 * level)), 0.0), textureLod(own, vec3(at, float(2 * level + 1)), 0.0));
}

// Moments, weights and slopes of a block at a level. All is written out, for arrays that are indexed by a variable are slow.
#define READ(level)                                                                            \
    {                                                                                          \
        Moments its;                                                                           \
        if (level < 2) its = near_moments(level, block, within, pool);                         \
        else its = far_moments(moments[min(level, RESOLUTIONS - 1)], level, block);            \
        vec3 variance = variance_of(its.first, its.second);                                    \
        if (level == 0) variance = with_small_pools(block, variance, pool);                    \
        float kept = 1.0 - beyond_lod(pool * exp2(float(-2 * level)), 0);                      \
        variance *= 1.0 - kept * kept;                                                         \
        asked[level] += 0.25 * variance;                                                       \
        vec2 slopes = slopes_of(its.first, its.second);                                        \
        if (level > 0) given += dot(variance, vec3(1.0)) * slopes * slopes;                    \
        own.weights[level] = vec4(sqrt(variance), slopes.x);                                   \
        SCALAR(own, level) = slopes.y;                                                         \
    }

Block block_at(ivec2 block) {
    Block own;
    own.scalars[0] = own.scalars[1] = own.scalars[2] = vec4(0.0);
    vec2 given = vec2(0.0);  // variance of chroma by the levels from the second on
    // The block's place in resolution 3, whose last texel may reach beyond an odd border.
    vec2 within = 0.5 * (vec2(block) + 0.5) / vec2((imageSize(weights).xy + 1) / 2);
    float pool = pool_at(seen_at(4.0 * (vec2(block) + 0.5)));
    EACH_LEVEL(READ)
    if (CHROMA == 0) return own;
    // No more than there is in the pool.
    Colours colours = colours_at(block, within, pool);
    vec2 limit = sqrt(min(colours.chroma / (given + SMALLEST_VARIANCE), 1.0));
#define LIMIT(level) { own.weights[level].a *= limit.x; SCALAR(own, level) *= limit.y; }
    EACH_LEVEL(LIMIT)
    SCALAR(own, LEVELS + 1) = colours.shape.x;
    SCALAR(own, LEVELS + 2) = colours.shape.y;
    SCALAR(own, LEVELS + 3) = colours.shape.z;
    SCALAR(own, LEVELS + 4) = colours.shape.w;
    return own;
}

void store(ivec2 place, ivec2 last, Block own, float deviation) {
    if (any(greaterThan(place, last))) return;
#define STORE(i) imageStore(weights, ivec3(place, i), own.weights[i] * vec4(gains[i], 1.0));
    EACH_LEVEL(STORE)
    SCALAR(own, LEVELS) = deviation;
    for (int layer = 0; 4 * layer < LEVELS + 1 + 4 * CHROMA; ++layer)
        imageStore(weights, ivec3(place, LEVELS + layer), own.scalars[layer]);
}

void main() {
    ivec2 first = 2 * ivec2(gl_GlobalInvocationID.xy), last = imageSize(weights).xy - 1;
    if (any(greaterThan(first, last))) return;
    asked[0] = asked[1] = asked[2] = asked[3] = asked[4] = asked[5] = vec3(0.0);
    // Blocks beyond an odd border stand for the last, and are not stored.
    Block a = block_at(first), b = block_at(min(first + ivec2(1, 0), last));
    Block c = block_at(min(first + ivec2(0, 1), last)), d = block_at(min(first + 1, last));
    find_gains();
    float deviation = deviation_of_all();
    store(first, last, a, deviation);
    store(first + ivec2(1, 0), last, b, deviation);
    store(first + ivec2(0, 1), last, c, deviation);
    store(first + 1, last, d, deviation);
}
