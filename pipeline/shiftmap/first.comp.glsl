#version 430
// Each tile's best shift along the parallax: a work group per tile, an invocation per length.
// Twin: Search.first_shifts() in tiles.py. Change both or neither.

#constant LENGTHS

#include "shift_cost.glsl"

layout(local_size_x = LENGTHS) in;

ivec2 along(ivec2 way, int longer, int length_px) {
    return ivec2(rounded(length_px * way.x, longer), rounded(length_px * way.y, longer));
}

bool has_source(Tile tile, ivec2 shift) {
    ivec2 place = corner_of(tile) + TILE_PX / 2 + shift;
    if (!is_inside(place)) return false;
    uvec2 found = imageLoad(planes, place).rg;
    return is_source(found, guide_of(tile) - guide_in(found));
}

// From the whole hole's width on, that no piece comes twice; or, where no background lies so far, from
// just past the hole.
ivec2 shift_by(Tile tile, int length_px) {
    ivec2 way = ivec2(tile.way_x, tile.way_y);
    int longer = max(abs(way.x), abs(way.y));
    // Ways that cancel out have no direction; any will do, for the search mends it.
    if (5 * longer <= tile.count) {
        way = ivec2(1, 0);
        longer = 1;
    }
    bool far = has_source(tile, along(way, longer, tile.across_px + 1));
    return along(way, longer, (far ? tile.across_px : tile.way_px) + 1 + length_px);
}

void main() {
    if (!is_listed()) return;
    int at = tile_at(place_at_hand());
    Tile tile = tiles[at];
    int choice = int(gl_LocalInvocationID.x);
    ivec2 shift = shift_by(tile, choice);
    if (is_best(cost_of(tile, shift), choice)) tiles[at].shift[0] = shift;
}
