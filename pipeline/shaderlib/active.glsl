// Which tiles of a list are in it.

layout(std430, binding = 3) readonly buffer Active { uint active_tiles[]; };

bool is_active(uint first, uint columns, ivec2 tile) {
    return active_tiles[first + uint(tile.y) * columns + uint(tile.x)] != 0u;
}
