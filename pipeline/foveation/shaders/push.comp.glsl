#version 430
// Push: choose each texel's level of detail, from a resolution's own and the coarser one's choice.
// Twin: select() in chain.py. Change both or neither.

#constant TILE    // work-group edge, texels
#constant BASE    // 1: the picture takes part
#constant LAYERS  // pyramid levels whose moments take part
#constant POWERS  // 1: the powers of colours take part

#include "pools.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform int halvings;  // of this resolution
uniform sampler2D fine;
uniform sampler2D coarse;  // chosen, linear
layout(rgba32f) uniform writeonly image2D chosen;
uniform sampler2DArray fine_moments;    // see pull.comp.glsl
uniform sampler2DArray coarse_moments;  // chosen, linear
layout(rgba32f) uniform writeonly image2DArray chosen_moments;
uniform sampler2DArray fine_powers;
uniform sampler2DArray coarse_powers;   // chosen, linear
layout(rgba32f) uniform writeonly image2DArray chosen_powers;

// All or nothing of the coarser one, as in most places, is half the work.
vec4 choice(sampler2DArray own, sampler2DArray below, ivec3 texel, vec2 within, float share) {
    vec4 found = vec4(0.0);
    if (share < 1.0) found = texelFetch(own, texel, 0);
    if (share > 0.0) found = mix(found, textureLod(below, vec3(within, float(texel.z)), 0.0), share);
    return found;
}

void main() {
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
    ivec2 fine_size = BASE == 1 ? imageSize(chosen) : imageSize(chosen_moments).xy;
    if (any(greaterThanEqual(texel, fine_size))) return;
    vec2 place = vec2(texel) + 0.5;
    float pool = pool_at(seen_at(place * float(1 << halvings)));
    // A texel's place in the coarser one, whose last texel may reach beyond an odd border.
    vec2 within = 0.5 * place / vec2((fine_size + 1) / 2);
    float share = beyond_lod(pool, halvings);
    if (BASE == 1) {
        vec4 base = vec4(0.0);
        if (share < 1.0) base = texelFetch(fine, texel, 0);
        if (share > 0.0) base = mix(base, textureLod(coarse, within, 0.0), share);
        imageStore(chosen, texel, base);
    }
    if (POWERS == 1)
        for (int layer = 0; layer < 3; ++layer) {
            ivec3 at = ivec3(texel, layer);
            imageStore(chosen_powers, at, choice(fine_powers, coarse_powers, at, within, share));
        }
    if (LAYERS > 0)
        for (int layer = 0; layer < 2 * LAYERS; ++layer) {
            ivec3 at = ivec3(texel, layer);
            int level = layer / 2;
            float part = beyond_lod(pool * exp2(float(-2 * level)), halvings - level);
            imageStore(chosen_moments, at, choice(fine_moments, coarse_moments, at, within, part));
        }
}
