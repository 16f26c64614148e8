#version 430
// Finish with noise that lies on the screen: see weighed_noise.glsl. A call makes 2x2 pixels.

#constant TILE         // work-group edge, 2x2 pixels

#include "weighed_noise.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

// A word is a band of 2x2 pixels, signed bytes, four bands a layer; bands level by level, high, along
// x, along y. It goes on at its borders.
uniform usampler2DArray noise;

const int LAYERS = (3 * LEVELS + 3) / 4;

vec4 band_of(uint word) {
    return vec4(ivec4(word << 24, word << 16, word << 8, word) >> 24);
}

void main() {
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(2 * cell, textureSize(source, 0)))) return;
    ivec2 place = cell % textureSize(noise, 0).xy;
    uint words[4 * LAYERS];
    for (int layer = 0; layer < LAYERS; ++layer) {
        uvec4 four = texelFetch(noise, ivec3(place, layer), 0);
        for (int i = 0; i < 4; ++i) words[4 * layer + i] = four[i];
    }
    mat3x4 bands[LEVELS];
    for (int level = 0; level < LEVELS; ++level)
        bands[level] = mat3x4(band_of(words[3 * level]), band_of(words[3 * level + 1]),
                              band_of(words[3 * level + 2]));
    add_noise(cell, bands);
}
