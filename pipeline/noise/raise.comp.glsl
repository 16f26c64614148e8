#version 430
// Bands of coarser levels brought up, and a level's own three beside them. A call makes 2x2 pixels.
// Twin: split() in tile.py. Change both or neither.

#constant TILE      // work-group edge, 2x2 pixels
#constant OLDER     // coarser levels
#constant HIGH      // 5x5 taps
#constant ORIENTED  // 5x5 taps, along x
#constant RAISING   // 5x5 taps, of the pixel of even column and row

#include "filters.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform isampler2D low;
uniform isampler2D soft;
// A band is half a word, the first the lower one; eight bands a layer, from the coarsest level on.
#if OLDER
uniform usampler2DArray coarse;
#endif
layout(rgba32ui) uniform writeonly uimage2DArray raised;

const int RAISINGS[] = RAISING;
const int HIGHS[] = HIGH;
const int ORIENTEDS[] = ORIENTED;
const int BEFORE = 3 * OLDER, LAYERS = (BEFORE + 3 + 7) / 8;

void main() {
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy), size = textureSize(low, 0);
    if (any(greaterThanEqual(2 * cell, size))) return;
    uvec4 words[4 * LAYERS];  // of the cell's pixels, one after the other
    for (int i = 0; i < 4 * LAYERS; ++i) words[i] = uvec4(0u);
#if OLDER
    ivec2 coarse_size = textureSize(coarse, 0).xy;
    for (int layer = 0; layer < (BEFORE + 7) / 8; ++layer) {
        ivec4 lower[4] = ivec4[](ivec4(0), ivec4(0), ivec4(0), ivec4(0)), upper[4] = lower;
        for (int y = 0; y < 5; ++y)
            for (int x = 0; x < 5; ++x) {
                ivec2 place = around(cell + ivec2(x, y) - 2, coarse_size);
                ivec4 pairs = ivec4(texelFetch(coarse, ivec3(place, layer), 0));
                ivec4 first = pairs << 16 >> 16, second = pairs >> 16;
                for (int pixel = 0; pixel < 4; ++pixel) {
                    int column = (pixel & 1) == 0 ? x : 4 - x, row = (pixel >> 1) == 0 ? y : 4 - y;
                    int tap = RAISINGS[5 * row + column];
                    lower[pixel] += tap * first;
                    upper[pixel] += tap * second;
                }
            }
        for (int pixel = 0; pixel < 4; ++pixel)
            words[LAYERS * pixel + layer] = (uvec4(divided(lower[pixel])) & 0xFFFFu) | uvec4(divided(upper[pixel])) << 16;
    }
#endif
    int own[36], softened[36];  // 6x6 pixels, the cell in their middle
    for (int i = 0; i < 36; ++i) {
        ivec2 place = around(2 * cell - 2 + ivec2(i % 6, i / 6), size);
        own[i] = texelFetch(low, place, 0).x;
        softened[i] = texelFetch(soft, place, 0).x;
    }
    for (int pixel = 0; pixel < 4; ++pixel) {
        int first = 6 * (pixel >> 1) + (pixel & 1);
        int sums[3] = int[](0, 0, 0);
        for (int y = 0; y < 5; ++y)
            for (int x = 0; x < 5; ++x) {
                int at = first + 6 * y + x;
                sums[0] += HIGHS[5 * y + x] * own[at];
                sums[1] += ORIENTEDS[5 * y + x] * softened[at];
                sums[2] += ORIENTEDS[5 * x + y] * softened[at];
            }
        for (int band = 0; band < 3; ++band) {
            int half_word = BEFORE + band, layer = half_word / 8;
            uint bits = uint(divided(sums[band])) & 0xFFFFu;
            words[LAYERS * pixel + layer][half_word / 2 % 4] |= bits << (16 * (half_word & 1));
        }
        for (int layer = 0; layer < LAYERS; ++layer)
            imageStore(raised, ivec3(2 * cell + ivec2(pixel & 1, pixel >> 1), layer), words[LAYERS * pixel + layer]);
    }
}
