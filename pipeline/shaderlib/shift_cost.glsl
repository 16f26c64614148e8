// What a shift of one tile costs, in whole numbers, and how a work group finds the least.
// Twin: Search in shiftmap/tiles.py. Change both or neither.

#constant TILE_PX
#constant WINDOW_PX        // pixels this far around a tile are compared too
#constant WINDOW_STEP_PX   // every so many of them
#constant LEAST_COMPARED   // fewer count as so many
#constant COST_SCALE
#constant NOT_KNOWN_COST   // of a tile none of whose pixels finds a source
#constant FARTHER_COST     // of one whose sources all lie clearly behind it
#constant THRESHOLD_STEPS  // of the guide

#include "lists.glsl"
#include "shift_tiles.glsl"
#include "shift_planes.glsl"

layout(rg32ui) uniform readonly uimage2D planes;

uniform uint list_index;
uniform uint list_first;

shared uint least;

bool is_listed() { return group_at_hand() < entries_in(list_index); }

ivec2 place_at_hand() { return place_of(entries[list_first + group_at_hand()]); }

int squared(ivec3 off) { return off.x * off.x + off.y * off.y + off.z * off.z; }

bool is_inside(ivec2 place) {
    return all(greaterThanEqual(place, ivec2(0))) && all(lessThan(place, imageSize(planes)));
}

int guide_of(Tile tile) { return rounded(tile.guide, tile.count); }

ivec2 corner_of(Tile tile) {
    return ivec2(rounded(tile.corner_x, SUBPIXELS * tile.count),
                 rounded(tile.corner_y, SUBPIXELS * tile.count));
}

// Whether what is there may be copied to a tile that lies `nearer` than it by so much.
bool is_source(uvec2 found, int nearer) { return !hole_in(found) && nearer <= THRESHOLD_STEPS; }

int cost_of(Tile tile, ivec2 shift) {
    int guide = guide_of(tile);
    ivec2 corner = corner_of(tile);
    int pixels = 0, sources = 0, compared = 0, farther = 0, own_error = 0, beside_error = 0;
    for (int y = -WINDOW_PX; y < TILE_PX + WINDOW_PX; y += WINDOW_STEP_PX) {
        for (int x = -WINDOW_PX; x < TILE_PX + WINDOW_PX; x += WINDOW_STEP_PX) {
            ivec2 place = corner + ivec2(x, y);
            if (!is_inside(place)) continue;
            uvec2 shown = imageLoad(planes, place).rg;
            if (abs(guide_in(shown) - guide) > THRESHOLD_STEPS) continue;
            bool own = hole_in(shown);
            pixels += int(own);
            if (!is_inside(place + shift)) continue;
            uvec2 found = imageLoad(planes, place + shift).rg;
            int nearer = guide - guide_in(found);
            if (!is_source(found, nearer)) continue;
            int error = squared(colour_in(shown) - (own ? low_in(found) : colour_in(found)));
            sources += int(own);
            compared += int(!own);
            farther += int(own && -nearer > THRESHOLD_STEPS);
            own_error += own ? error : 0;
            beside_error += own ? 0 : error;
        }
    }
    return COST_SCALE * own_error / max(sources, 1)
         + COST_SCALE * beside_error / max(compared, LEAST_COMPARED)
         + COST_SCALE * NOT_KNOWN_COST * (pixels - sources) / max(pixels, 1)
         + COST_SCALE * FARTHER_COST * farther / max(pixels, 1);
}

// Whether this invocation's choice is the best of its work group's; of equals, the first.
bool is_best(int cost, int choice) {
    uint key = uint(cost) << 6 | uint(choice);
    if (gl_LocalInvocationID.x == 0u) least = 0xffffffffu;
    barrier();
    atomicMin(least, key);
    barrier();
    return least == key;
}
