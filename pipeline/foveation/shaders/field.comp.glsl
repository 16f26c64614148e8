#version 430
// Field: one push of the noise that displaces, pooled with a share of the eye's deviation.
// Twin: unit_field() in displacement.py. Change both or neither.

#constant TILE            // work-group edge, texels
#constant LEAST_VARIANCE  // of the field's pools, over HALVED_VARIANCE

#include "pools.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform sampler2D own;     // white noise, halved so often
uniform sampler2D coarse;  // chosen, linear
layout(rg32f) uniform writeonly image2D chosen;
uniform int halvings;
uniform float smoothness;

void main() {
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy), size = imageSize(chosen);
    if (any(greaterThanEqual(texel, size))) return;
    vec2 place = vec2(texel) + 0.5;
    float pool = pool_at(seen_at(place * float(1 << halvings)));
    pool = max(smoothness * smoothness * pool, LEAST_VARIANCE);
    vec2 within = 0.5 * place / vec2((size + 1) / 2);
    vec2 noise = mix(texelFetch(own, texel, 0).rg, textureLod(coarse, within, 0.0).rg,
                     beyond_lod(pool, halvings));
    imageStore(chosen, texel, vec4(noise, 0.0, 0.0));
}
