#version 430
// Gains: what each block of 4x4 pixels multiplies every band's noise by. A call makes 2x2 blocks, with
// one spectral gain: what bands measure of each other is most of the work.
// Twin: wanted_by_blocks() in moments.py, shaped_noise() in reference.py. Change both or neither.

#constant TILE               // work-group edge, 2x2 blocks
#constant SMALLEST_VARIANCE  // added to what is divided by
#constant PARTNER_SHARE      // of the small pool beside, along each axis
#constant CHROMA             // 1: Cb and Cr go with luma; 0: none

#include "pools.glsl"
#include "spectral_gains.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

// A layer a level: weights of high, along x, along y; a: Cb that goes with luma. Then Cr of the
// levels, four a layer.
layout(rgba16f, binding = 0) uniform image2DArray weights;
// Moments as pull.comp.glsl writes them, chosen, at resolutions 2 and coarser: level k's at k + 1.
layout(binding = 0) uniform sampler2DArray small_moments;  // of resolution 1, not chosen
layout(binding = 1) uniform sampler2DArray moments_2;
#if LEVELS > 2
layout(binding = 2) uniform sampler2DArray moments_3;
#endif
#if LEVELS > 3
layout(binding = 3) uniform sampler2DArray moments_4;
#endif
#if LEVELS > 4
layout(binding = 4) uniform sampler2DArray moments_5;
#endif
#if LEVELS > 5
layout(binding = 5) uniform sampler2DArray moments_6;
#endif

// Variances of 2x2 blocks, summed. Never indexed by a variable, which is slow.
vec3 asked[6];

vec3 variance_of(vec4 first, vec4 second) { return max(first.xyz - second.xyz * second.xyz, 0.0); }

ivec2 block;
bool counted;  // blocks beyond an odd border stand for the last, and are not stored

vec2 slopes_of(vec4 first, vec4 second) {
    return float(CHROMA) * vec2(first.a, second.a) / (first.x + first.y + first.z + SMALLEST_VARIANCE);
}

// Put by what a level's noise is to be multiplied, but for its gain.
void put(int level, vec3 variance, float blue, float pool) {
    float kept = 1.0 - beyond_lod(pool * exp2(float(-2 * level)), 0);
    variance *= 1.0 - kept * kept;
    asked[level] += 0.25 * variance;
    if (counted) imageStore(weights, ivec3(block, level), vec4(sqrt(variance), blue));
}

#define READ(level, moments, halvings, red)                                                \
    {                                                                                      \
        vec2 at = (vec2(block) + 0.5) / float(1 << (halvings - 2)) / vec2(textureSize(moments, 0).xy); \
        vec4 first = textureLod(moments, vec3(at, float(2 * level)), 0.0);                 \
        vec4 second = textureLod(moments, vec3(at, float(2 * level + 1)), 0.0);            \
        vec2 slopes = slopes_of(first, second);                                            \
        red = slopes.y;                                                                    \
        vec3 variance = variance_of(first, second);                                        \
        if (level == 0) variance = with_small_pools(variance, pool);                       \
        put(level, variance, slopes.x, pool);                                              \
    }

// Of the finest level, where pools are smaller than a block.
vec3 with_small_pools(vec3 wide, float pool) {
    vec2 size = vec2(textureSize(small_moments, 0).xy);
    // Towards the block's middle, where linear sampling mixes in what lies beside; see _widened().
    vec2 near = 2.0 * vec2(block) + 0.5, far = min(near + 1.0, size - 0.5);
    vec2 in_near = near + PARTNER_SHARE * (far - near), in_far = far + PARTNER_SHARE * (near - far);
    vec3 fine = vec3(0.0);
#define SMALL(x, y) fine += 0.25 * variance_of(textureLod(small_moments, vec3(vec2(x, y) / size, 0.0), 0.0), \
                                               textureLod(small_moments, vec3(vec2(x, y) / size, 1.0), 0.0));
    SMALL(in_near.x, in_near.y) SMALL(in_far.x, in_near.y) SMALL(in_near.x, in_far.y) SMALL(in_far.x, in_far.y)
    float share = beyond_lod(pool, 1);
    return mix(fine, wide, share) + share * (1.0 - share) * max(wide - fine, 0.0);
}

void read_block(ivec2 place, ivec2 last) {
    block = min(place, last);
    counted = block == place;
    float pool = pool_at(seen_at(4.0 * (vec2(block) + 0.5)));
    vec4 red = vec4(0.0);
    READ(0, moments_2, 2, red.x)
#if LEVELS > 1
    READ(1, moments_2, 2, red.y)
#endif
#if LEVELS > 2
    READ(2, moments_3, 3, red.z)
#endif
#if LEVELS > 3
    READ(3, moments_4, 4, red.w)
#endif
    if (counted) imageStore(weights, ivec3(block, LEVELS), red);
#if LEVELS > 4
    red = vec4(0.0);
    READ(4, moments_5, 5, red.x)
#if LEVELS > 5
    READ(5, moments_6, 6, red.y)
#endif
    if (counted) imageStore(weights, ivec3(block, LEVELS + 1), red);
#endif
}

void multiply(ivec2 place, ivec2 last, int level, vec3 gain) {
    if (any(greaterThan(place, last))) return;
    vec4 own = imageLoad(weights, ivec3(place, level));
    imageStore(weights, ivec3(place, level), vec4(own.rgb * gain, own.a));
}

void main() {
    ivec2 first = 2 * ivec2(gl_GlobalInvocationID.xy), last = imageSize(weights).xy - 1;
    if (any(greaterThan(first, last))) return;
    asked[0] = asked[1] = asked[2] = asked[3] = asked[4] = asked[5] = vec3(0.0);
    read_block(first, last);
    read_block(first + ivec2(1, 0), last);
    read_block(first + ivec2(0, 1), last);
    read_block(first + 1, last);
    want(0, asked[0]);
    if (LEVELS > 1) want(1, asked[1]);
    if (LEVELS > 2) want(2, asked[2]);
    if (LEVELS > 3) want(3, asked[3]);
    if (LEVELS > 4) want(4, asked[4]);
    if (LEVELS > 5) want(5, asked[5]);
    for (int level = 0; level < LEVELS; ++level) {
        vec3 own = asked[0];
#define OWN(i) if (LEVELS > i && level == i) own = asked[i];
        OWN(1) OWN(2) OWN(3) OWN(4) OWN(5)
        vec3 gain = gain_of(level, own, measured_at(level));
        multiply(first, last, level, gain);
        multiply(first + ivec2(1, 0), last, level, gain);
        multiply(first + ivec2(0, 1), last, level, gain);
        multiply(first + 1, last, level, gain);
    }
}
