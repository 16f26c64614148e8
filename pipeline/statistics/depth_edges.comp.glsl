#version 430
// Tiles in which the first halving has to look at depth: those within whose reach depth jumps go
// into one list, all others into another.

#constant HALVED_TILE  // edge of a tile, pixels of resolution 2

#include "lists.glsl"
#include "active.glsl"

// A row of tiles, so that the lists follow the rows as well.
layout(local_size_x = LIST_GROUP) in;

layout(rg32f) uniform readonly image2D extents;  // of 4x4 pixels: least, largest guide

uniform float depth_threshold;
uniform uvec3 source_region;
uniform uvec2 jumps_list;  // index and first entry
uniform uvec2 plain_list;

vec2 both(vec2 a, vec2 b) { return vec2(min(a.x, b.x), max(a.y, b.y)); }

vec2 row(int y, ivec4 x) {
    return both(both(imageLoad(extents, ivec2(x.x, y)).rg, imageLoad(extents, ivec2(x.y, y)).rg),
                both(imageLoad(extents, ivec2(x.z, y)).rg, imageLoad(extents, ivec2(x.w, y)).rg));
}

void main() {
    // A pixel of resolution 3. The low-pass reaches a pixel beyond it, so do 4x4 extents.
    ivec2 tile = ivec2(gl_GlobalInvocationID.xy), last = imageSize(extents) - 1;
    if (any(greaterThan(2 * tile, last)) || !is_active(source_region, tile)) return;
    ivec4 x = clamp(2 * tile.x + ivec4(-1, 0, 1, 2), 0, last.x);
    ivec4 y = clamp(2 * tile.y + ivec4(-1, 0, 1, 2), 0, last.y);
    vec2 found = both(both(row(y.x, x), row(y.y, x)), both(row(y.z, x), row(y.w, x)));
    uvec2 list = found.y - found.x > depth_threshold ? jumps_list : plain_list;
    add(list.x, list.y, entry_of(tile, 0), uint(LIST_GROUP / (HALVED_TILE * HALVED_TILE)));
}
