// Tiles that are in a region.

layout(std430) readonly buffer Active { uint active_tiles[]; };

// `region`: where its flags start, tiles per row, log2 of a tile's edge in pixels.
bool is_active(uvec3 region, ivec2 pixel) {
    uvec2 tile = uvec2(pixel) >> region.z;
    return active_tiles[region.x + tile.y * region.y + tile.x] != 0u;
}
