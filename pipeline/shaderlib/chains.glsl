// Where a chain's texel starts in its image: PLANES neighbours in a row, chains below each other.

ivec2 texel_at(ivec2 pixel, int chain, ivec2 size) {
    return ivec2(pixel.x * PLANES, chain * size.y + pixel.y);
}
