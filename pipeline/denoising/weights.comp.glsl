#version 430
// Weights: what each block of 4x4 pixels multiplies every band's noise by, from maps of deviations.
// A call makes 2x2 blocks, which share spectral gains. Twin: metamer_of() in maps.py and
// shaped_noise() in foveation/reference.py. Change both or neither.

#constant TILE  // work-group edge, 2x2 blocks

#include "spectral_gains.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

// Both as gains.comp.glsl has them: a layer a level, high, along x, along y; a: Cb that goes with
// luma. Then Cr of the levels, four a layer.
uniform sampler2DArray maps;
layout(rgba16f) uniform writeonly image2DArray weights;

void main() {
    ivec2 first = 2 * ivec2(gl_GlobalInvocationID.xy), last = imageSize(weights).xy - 1;
    if (any(greaterThan(first, last))) return;
    for (int level = 0; level < LEVELS; ++level) {
        vec3 sum = vec3(0.0);
        for (int k = 0; k < 4; ++k) {
            vec3 deviation = texelFetch(maps, ivec3(min(first + ivec2(k & 1, k >> 1), last), level), 0).xyz;
            sum += deviation * deviation;
        }
        asked[level] = 0.25 * sum;
    }
    find_gains();
    for (int k = 0; k < 4; ++k) {
        ivec2 block = first + ivec2(k & 1, k >> 1);
        if (any(greaterThan(block, last))) continue;
        for (int level = 0; level < LEVELS; ++level) {
            vec4 own = texelFetch(maps, ivec3(block, level), 0);
            imageStore(weights, ivec3(block, level), vec4(own.xyz * gains[level], own.a));
        }
        for (int layer = LEVELS; layer < LEVELS + (LEVELS + 3) / 4; ++layer)
            imageStore(weights, ivec3(block, layer), texelFetch(maps, ivec3(block, layer), 0));
    }
}
