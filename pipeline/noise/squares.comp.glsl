#version 430
// Sums of squares of every band, for blocks of 64x64 pixels. A work group sums a block of eight bands.
// Twin: square_sum() in tile.py. Change both or neither.

#constant LAYERS

layout(local_size_x = 64) in;

uniform usampler2DArray raised;  // see raise.comp.glsl
// For each block and layer, of the lower bands of four words and of the upper ones: low 16 bits of
// squares, then the rest.
layout(std430) writeonly buffer OfBlocks { uvec4 sums[]; };

shared uvec4 columns[64];

void main() {
    ivec2 first = 64 * ivec2(gl_WorkGroupID.xy), size = textureSize(raised, 0).xy;
    int own = int(gl_LocalInvocationID.x);
    int block = int(gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x);
    for (int index = 0; index < 4 * LAYERS; ++index) {
        int layer = index / 4, part = index % 4;
        uvec4 sum = uvec4(0u);
        if (first.x + own < size.x)
            for (int y = first.y; y < min(first.y + 64, size.y); ++y) {
                ivec4 pairs = ivec4(texelFetch(raised, ivec3(first.x + own, y, layer), 0));
                ivec4 bands = part < 2 ? pairs << 16 >> 16 : pairs >> 16;
                uvec4 squares = uvec4(bands * bands);
                sum += (part & 1) == 0 ? squares & 0xFFFFu : squares >> 16;
            }
        columns[own] = sum;
        barrier();
        for (int step = 32; step > 0; step /= 2) {
            if (own < step) columns[own] += columns[own + step];
            barrier();
        }
        if (own == 0) sums[4 * LAYERS * block + index] = columns[0];
        barrier();
    }
}
