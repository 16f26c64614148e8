#version 430
// Push: choose each texel's level of detail, from a resolution's own and the coarser one's choice.
// In place. Twin: select() in chain.py. Change both or neither.

#constant TILE    // work-group edge, texels
#constant BASE    // 1: the picture takes part
#constant LAYERS  // pyramid levels whose moments take part
#constant POWERS  // 1: the powers of Cb and Cr take part

#include "pools.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform ivec2 fine_size;
uniform int halvings;  // of this resolution
#if BASE
layout(rgba32f) uniform image2D fine;
uniform sampler2D coarse;  // linear
#endif
#if LAYERS
layout(rgba32f) uniform image2DArray fine_moments;  // see pull.comp.glsl
uniform sampler2DArray coarse_moments;       // linear
#endif
#if POWERS
layout(rgba32f) uniform image2DArray fine_powers;
uniform sampler2DArray coarse_powers;        // linear
#endif

void main() {
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(texel, fine_size))) return;
    vec2 place = vec2(texel) + 0.5;
    float pool = pool_at(seen_at(place * float(1 << halvings)));
    // A texel's place in the coarser one, whose last texel may reach beyond an odd border.
    vec2 within = 0.5 * place / vec2((fine_size + 1) / 2);
    // All or nothing of the coarser one, as in most places, is half the work or none.
    float share = beyond_lod(pool, halvings);
#if BASE
    if (share > 0.0) {
        vec4 below = textureLod(coarse, within, 0.0);
        imageStore(fine, texel, share < 1.0 ? mix(imageLoad(fine, texel), below, share) : below);
    }
#endif
#if POWERS
    if (share > 0.0) {
        for (int layer = 0; layer < 2; ++layer) {
            vec4 below = textureLod(coarse_powers, vec3(within, float(layer)), 0.0);
            if (share < 1.0) below = mix(imageLoad(fine_powers, ivec3(texel, layer)), below, share);
            imageStore(fine_powers, ivec3(texel, layer), below);
        }
    }
#endif
#if LAYERS
    for (int level = 0; level < LAYERS; ++level) {
        float chosen = beyond_lod(pool * exp2(float(-2 * level)), halvings - level);
        if (chosen == 0.0) continue;
        for (int layer = 2 * level; layer < 2 * level + 2; ++layer) {
            vec4 below = textureLod(coarse_moments, vec3(within, float(layer)), 0.0);
            if (chosen < 1.0) below = mix(imageLoad(fine_moments, ivec3(texel, layer)), below, chosen);
            imageStore(fine_moments, ivec3(texel, layer), below);
        }
    }
#endif
}
