#version 430
// Mixed bands in steps, as finish_screen.comp.glsl reads them. A call makes 2x2 pixels.
// Twin: mixed() in tile.py and grained() in foveation/noise_plane.py. Change both or neither.

#constant TILE        // work-group edge, 2x2 pixels
#constant LEVELS
#constant STEP_BITS   // of a step of the noise, behind the point
#constant MOST_STEPS  // to either side

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform usampler2DArray raised;  // see raise.comp.glsl
uniform int margin;              // pixels before the first
uniform int weights[9 * LEVELS * LEVELS];  // of bands in each mixed one, level by level
// A word is a band of 2x2 pixels, signed bytes, four bands a layer.
layout(rgba32ui) uniform writeonly uimage2DArray noise;

const int BANDS = 3 * LEVELS, LAYERS = (BANDS + 7) / 8;

void main() {
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(cell, imageSize(noise).xy))) return;
    ivec4 bands[8 * LAYERS];  // of the cell's pixels, from the coarsest level on
    for (int pixel = 0; pixel < 4; ++pixel) {
        ivec2 place = min(2 * cell + ivec2(pixel & 1, pixel >> 1) + margin, textureSize(raised, 0).xy - 1);
        for (int layer = 0; layer < LAYERS; ++layer) {
            ivec4 pairs = ivec4(texelFetch(raised, ivec3(place, layer), 0));
            for (int word = 0; word < 4; ++word) {
                bands[8 * layer + 2 * word][pixel] = pairs[word] << 16 >> 16;
                bands[8 * layer + 2 * word + 1][pixel] = pairs[word] >> 16;
            }
        }
    }
    uint words[BANDS];
    for (int mixed = 0; mixed < BANDS; ++mixed) {
        ivec4 sum = ivec4(1 << (STEP_BITS - 1));
        // Mixing couples neighbouring levels only.
        for (int level = max(mixed / 3 - 1, 0); level < min(mixed / 3 + 2, LEVELS); ++level)
            for (int band = 0; band < 3; ++band)
                sum += weights[BANDS * mixed + 3 * level + band] * bands[3 * (LEVELS - 1 - level) + band];
        uvec4 bytes = uvec4(clamp(sum >> STEP_BITS, -MOST_STEPS, MOST_STEPS)) & 0xFFu;
        words[mixed] = bytes.x | bytes.y << 8 | bytes.z << 16 | bytes.w << 24;
    }
    for (int layer = 0; layer < (BANDS + 3) / 4; ++layer) {
        uvec4 four = uvec4(0u);
        for (int i = 0; i < 4 && 4 * layer + i < BANDS; ++i) four[i] = words[4 * layer + i];
        imageStore(noise, ivec3(cell, layer), four);
    }
}
