#version 430
// Tiles take neighbours' shifts, or small steps, where cost with disagreement falls: a work group per
// tile, an invocation per choice. All choose at once, by what their neighbours had before.
// Twin: Search.agree() in tiles.py. Change both or neither.

#constant DISAGREEMENT_COST  // of shifts that have nothing in common with their neighbours'
#constant DISAGREEMENT_PX    // shifts as far apart as this have nothing in common

#include "shift_cost.glsl"

#define CHOICES 13  // its own, eight neighbours', four steps

layout(local_size_x = 16) in;

uniform int before;   // which of two shifts is read; the other is written
uniform int step_px;

// Its eight neighbours, row by row.
ivec2 neighbour(int number) {
    int cell = number < 4 ? number : number + 1;
    return ivec2(cell % 3 - 1, cell / 3 - 1);
}

int disagreement(ivec2 place, ivec2 shift) {
    int far = 0, count = 0;
    for (int number = 0; number < 8; ++number) {
        int beside = tile_at(place + neighbour(number));
        if (tiles[beside].count == 0) continue;
        ivec2 off = abs(tiles[beside].shift[before] - shift);
        far += min(off.x + off.y, DISAGREEMENT_PX);
        ++count;
    }
    return COST_SCALE * DISAGREEMENT_COST * far / (DISAGREEMENT_PX * max(count, 1));
}

void main() {
    if (!is_listed()) return;
    ivec2 place = place_at_hand();
    int at = tile_at(place);
    Tile tile = tiles[at];
    int choice = int(gl_LocalInvocationID.x);
    bool offered = choice < CHOICES;
    ivec2 shift = tile.shift[before];
    if (choice >= 1 && choice <= 8) {
        int beside = tile_at(place + neighbour(choice - 1));
        offered = tiles[beside].count > 0;
        shift = tiles[beside].shift[before];
    }
    if (choice == 9) shift.x += step_px;
    if (choice == 10) shift.y += step_px;
    if (choice == 11) shift.x -= step_px;
    if (choice == 12) shift.y -= step_px;
    int cost = 1 << 24;  // more than any
    if (offered) cost = cost_of(tile, shift) + disagreement(place, shift);
    if (is_best(cost, choice)) tiles[at].shift[1 - before] = shift;
}
