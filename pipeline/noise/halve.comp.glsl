#version 430
// A level of noise softened, and halved into the next one. A call reads what 2x2 pixels need.
// Twin: split() in tile.py. Change both or neither.

#constant TILE     // work-group edge, 2x2 pixels
#constant SOFT     // 7x7 taps
#constant HALVING  // 4x4 taps

#include "filters.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform isampler2D low;
layout(r32i) uniform writeonly iimage2D soft;
layout(r32i) uniform writeonly iimage2D next;

const int SOFTS[] = SOFT;
const int HALVINGS[] = HALVING;

void main() {
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy), size = imageSize(soft);
    if (any(greaterThanEqual(2 * cell, size))) return;
    int near[64];  // 8x8 pixels, the cell in their middle
    for (int i = 0; i < 64; ++i)
        near[i] = texelFetch(low, around(2 * cell - 3 + ivec2(i & 7, i >> 3), size), 0).x;
    for (int pixel = 0; pixel < 4; ++pixel) {
        ivec2 own = ivec2(pixel & 1, pixel >> 1);
        int sum = 0;
        for (int y = 0; y < 7; ++y)
            for (int x = 0; x < 7; ++x) sum += SOFTS[7 * y + x] * near[8 * (own.y + y) + own.x + x];
        imageStore(soft, 2 * cell + own, ivec4(divided(sum)));
    }
    int sum = 0;
    for (int y = 0; y < 4; ++y)
        for (int x = 0; x < 4; ++x) sum += HALVINGS[4 * y + x] * near[8 * (y + 2) + x + 2];
    imageStore(next, cell, ivec4(divided(sum)));
}
