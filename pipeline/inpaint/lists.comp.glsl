#version 430
// Lists: for each work list, which tiles have a marked cell within so many rings.
// Twin: near_a_hole() in reference.py, its second half.

#constant GROUP

#include "lists.glsl"

layout(local_size_x = GROUP) in;

struct List {
    uint resolution;      // of the tiles
    uint columns;         // tiles per row
    uint tiles;           // in all
    uint first;           // where its entries start
    uint cell_resolution;
    uint cell_first;
    uint cell_columns;
    uint cell_rows;
    int rings;
};

layout(std430, binding = 0) readonly buffer Cells { uint cells[]; };
layout(std430, binding = 3) writeonly buffer Active { uint active_tiles[]; };
layout(std430, binding = 7) readonly buffer Lists { List lists[]; };

uniform uint list_count;

bool near_a_hole(List list, ivec2 tile) {
    // The cells that the tile overlaps: one or part of one, or several if cells are finer.
    int shift = int(list.resolution) - int(list.cell_resolution);
    ivec2 first = shift >= 0 ? tile << shift : tile >> -shift;
    ivec2 last = shift >= 0 ? ((tile + 1) << shift) - 1 : first;
    first = max(first - list.rings, ivec2(0));
    last = min(last + list.rings, ivec2(list.cell_columns, list.cell_rows) - 1);
    uint found = 0u;
    for (int y = first.y; y <= last.y; ++y) {
        for (int x = first.x; x <= last.x; ++x) {
            found |= cells[list.cell_first + uint(y) * list.cell_columns + uint(x)];
        }
    }
    return found != 0u;
}

void main() {
    // A work group sees one list only: lists start at multiples of its size.
    uint index = list_count - 1u;
    while (gl_WorkGroupID.x * GROUP < lists[index].first) --index;
    List list = lists[index];
    uint item = gl_GlobalInvocationID.x;
    uint place = item - list.first;
    if (place >= list.tiles) return;
    uvec2 tile = uvec2(place % list.columns, place / list.columns);
    bool found = near_a_hole(list, ivec2(tile));
    active_tiles[item] = uint(found);
    if (found) {
        uint slot = atomicAdd(counts[index].w, 1u);
        entries[list.first + slot] = entry_of(ivec2(tile));
        if (slot < MOST_GROUPS) atomicAdd(counts[index].x, 1u);
    }
}
