#version 430
// Forget the tiles of the last frame.

#include "shift_tiles.glsl"

layout(local_size_x = 64) in;

void main() {
    uint tile = gl_GlobalInvocationID.x;
    if (tile >= uint(table_size.x * table_size.y)) return;
    tiles[tile].count = 0;
    tiles[tile].way_y = 0;
    tiles[tile].way_x = 0;
    tiles[tile].way_px = 0;
    tiles[tile].corner_y = 0;
    tiles[tile].corner_x = 0;
    tiles[tile].guide = 0;
    tiles[tile].across_px = 0;
    tiles[tile].there = 0u;
    tiles[tile].wanted = 0u;
}
