#version 430
// Weights: what each block of 4x4 pixels multiplies every band's noise by, from maps of deviations.
// A call makes 2x2 blocks, which share spectral gains. Twin: metamer_of() in maps.py and
// lost_noise() in foveation/reference.py. Change both or neither.

#constant TILE  // work-group edge, 2x2 blocks

#include "spectral_gains.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform sampler2DArray maps;  // as weights are, but for the deviation, which they lack
// See weighed_noise.glsl.
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
    float deviation = deviation_of_all();
    for (int k = 0; k < 4; ++k) {
        ivec2 block = first + ivec2(k & 1, k >> 1);
        if (any(greaterThan(block, last))) continue;
        for (int level = 0; level < LEVELS; ++level) {
            vec4 own = texelFetch(maps, ivec3(block, level), 0);
            imageStore(weights, ivec3(block, level), vec4(own.xyz * gains[level], own.a));
        }
        for (int layer = 0; 4 * layer <= LEVELS; ++layer) {
            vec4 scalars = texelFetch(maps, ivec3(block, LEVELS + layer), 0);
            if (layer == LEVELS / 4) scalars[LEVELS % 4] = deviation;
            imageStore(weights, ivec3(block, LEVELS + layer), scalars);
        }
    }
}
