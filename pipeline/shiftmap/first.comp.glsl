#version 430
// Each tile's best shift along the parallax, from just past the hole on: a work group per tile, an
// invocation per length.
// Twin: Search.first_shifts() in tiles.py. Change both or neither.

#constant LENGTHS

#include "shift_cost.glsl"

layout(local_size_x = LENGTHS) in;

ivec2 shift_by(Tile tile, int length_px) {
    ivec2 way = ivec2(tile.way_x, tile.way_y);
    int longer = max(abs(way.x), abs(way.y));
    // Ways that cancel out have no direction; any will do, for the search mends it.
    if (5 * longer <= tile.count) {
        way = ivec2(1, 0);
        longer = 1;
    }
    ivec2 shift = (tile.way_px + 1 + length_px) * way;
    return ivec2(rounded(shift.x, longer), rounded(shift.y, longer));
}

void main() {
    if (!is_listed()) return;
    int at = tile_at(place_at_hand());
    Tile tile = tiles[at];
    int choice = int(gl_LocalInvocationID.x);
    ivec2 shift = shift_by(tile, choice);
    if (is_best(cost_of(tile, shift), choice)) tiles[at].shift[0] = shift;
}
