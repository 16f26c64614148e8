#version 430
// Noise of a seed: two fixed tiles, each moved to a place of the seed's, added. In whole numbers.
// Twin: seeded_steps() in noise_plane.py. Change both or neither.

#constant TILE             // work-group edge, texels
#constant MOST_STEPS
#constant ROOT_HALF_16BIT  // 2^16 over the root of 2

layout(local_size_x = TILE, local_size_y = TILE) in;

// As finish_screen.comp.glsl reads noise: one tile's layers, the other's. Edges are powers of two.
uniform usampler2DArray parts;
layout(rgba32ui) uniform writeonly uimage2DArray noise;
uniform ivec4 moved;            // of both tiles, texels: x and y

ivec4 steps_of(uint word) { return ivec4(word << 24, word << 16, word << 8, word) >> 24; }

uint word_of(ivec4 steps) {
    uvec4 bytes = uvec4(clamp(steps, -MOST_STEPS, MOST_STEPS)) & 255u;
    return bytes.x | bytes.y << 8 | bytes.z << 16 | bytes.w << 24;
}

void main() {
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy), size = imageSize(noise).xy;
    if (any(greaterThanEqual(texel, size))) return;
    ivec2 last = size - 1, first = (texel - moved.xy) & last, second = (texel - moved.zw) & last;
    int layers = imageSize(noise).z;
    for (int layer = 0; layer < layers; ++layer) {
        uvec4 a = texelFetch(parts, ivec3(first, layer), 0);
        uvec4 b = texelFetch(parts, ivec3(second, layers + layer), 0);
        uvec4 words;
        for (int i = 0; i < 4; ++i)
            words[i] = word_of((ROOT_HALF_16BIT * (steps_of(a[i]) + steps_of(b[i])) + 32768) >> 16);
        imageStore(noise, ivec3(texel, layer), words);
    }
}
