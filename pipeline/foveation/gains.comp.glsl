#version 430
// Gains: what each block of 4x4 pixels multiplies every band's noise by.
// Twin: wanted_by_blocks() in moments.py, shaped_noise() in reference.py. Change both or neither.

#constant TILE               // work-group edge, blocks
#constant SMALLEST_VARIANCE  // added to what is divided by
#constant CHROMA             // 1: Cb and Cr go with luma; 0: none

#include "pools.glsl"
#include "spectral_gains.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

// A layer a level: weights of high, along x, along y; a: Cb that goes with luma. Then Cr of the
// levels, four a layer.
layout(rgba32f, binding = 0) uniform writeonly image2DArray weights;
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

vec3 asked[LEVELS];
vec2 slopes[LEVELS];

vec3 variance_of(vec4 first, vec4 second) { return max(first.xyz - second.xyz * second.xyz, 0.0); }

void read_level(int level, vec4 first, vec4 second, float pool) {
    float kept = 1.0 - beyond_lod(pool * exp2(float(-2 * level)), 0);
    asked[level] = variance_of(first, second) * (1.0 - kept * kept);
    slopes[level] = float(CHROMA) * vec2(first.a, second.a) / (first.x + first.y + first.z + SMALLEST_VARIANCE);
}

#define READ(level, moments, halvings)                                                     \
    {                                                                                      \
        vec2 at = (vec2(block) + 0.5) / float(1 << (halvings - 2)) / vec2(textureSize(moments, 0).xy); \
        read_level(level, textureLod(moments, vec3(at, float(2 * level)), 0.0),            \
                   textureLod(moments, vec3(at, float(2 * level + 1)), 0.0), pool);        \
    }

void main() {
    ivec2 block = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(block, imageSize(weights).xy))) return;
    float pool = pool_at(seen_at(4.0 * (vec2(block) + 0.5)));
    READ(0, moments_2, 2)
#if LEVELS > 1
    READ(1, moments_2, 2)
#endif
    {
        // Pools of the finest level smaller than a block.
        ivec2 last = textureSize(small_moments, 0).xy - 1;
        ivec2 near = 2 * block, far = min(2 * block + 1, last);
        vec3 fine = vec3(0.0);
        for (int child = 0; child < 4; ++child) {
            ivec2 at = ivec2((child & 1) == 0 ? near.x : far.x, child < 2 ? near.y : far.y);
            fine += 0.25 * variance_of(texelFetch(small_moments, ivec3(at, 0), 0),
                                       texelFetch(small_moments, ivec3(at, 1), 0));
        }
        vec3 wide = variance_of(texelFetch(moments_2, ivec3(block, 0), 0),
                                texelFetch(moments_2, ivec3(block, 1), 0));
        float share = beyond_lod(pool, 1), kept = 1.0 - beyond_lod(pool, 0);
        vec3 between = max(wide - fine, 0.0);
        vec3 variance = mix(fine, wide, share) + share * (1.0 - share) * between;
        asked[0] = variance * (1.0 - kept * kept);
    }
#if LEVELS > 2
    READ(2, moments_3, 3)
#endif
#if LEVELS > 3
    READ(3, moments_4, 4)
#endif
#if LEVELS > 4
    READ(4, moments_5, 5)
#endif
#if LEVELS > 5
    READ(5, moments_6, 6)
#endif
    for (int level = 0; level < LEVELS; ++level) want(level, asked[level]);
    for (int level = 0; level < LEVELS; ++level) {
        vec3 weight = sqrt(asked[level]) * gain_of(level, asked[level], measured_at(level));
        imageStore(weights, ivec3(block, level), vec4(weight, slopes[level].x));
    }
    for (int first = 0; first < LEVELS; first += 4) {
        vec4 red = vec4(0.0);
        for (int i = 0; i < 4; ++i) if (first + i < LEVELS) red[i] = slopes[first + i].y;
        imageStore(weights, ivec3(block, LEVELS + first / 4), red);
    }
}
