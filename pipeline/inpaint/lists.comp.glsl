#version 430
// Lists: for each region, which tiles have a marked cell within so many rings; they go into its lists.
// Twin: near_a_hole() in reference.py, its second half.

#constant GROUP

#include "lists.glsl"

layout(local_size_x = GROUP) in;

// The tiles of one resolution near the marked cells of another, and the lists they go into.
struct Region {
    uint resolution;      // of the tiles
    uint columns;         // tiles per row
    uint tiles;           // in all
    uint first;           // where their active flags start
    uint cell_resolution;
    uint cell_first;
    uint cell_columns;
    uint cell_rows;
    int rings;
    uint own_list;        // of the tiles themselves
    uint own_first;
    uint own_chain;
    uint own_per_group;   // tiles that one work group visits; 0: no list
    uint chains_list;     // of tiles and chains
    uint chains_first;
    int first_chain;
    int end_chain;
};

layout(std430) readonly buffer Cells { uint cells[]; };
layout(std430) writeonly buffer Active { uint active_tiles[]; };
layout(std430) readonly buffer Regions { Region regions[]; };
layout(std430) readonly buffer OfGroups { uint region_of_group[]; };

bool near_a_hole(Region region, ivec2 tile) {
    // The cells that the tile overlaps: one or part of one, or several if cells are finer.
    int shift = int(region.resolution) - int(region.cell_resolution);
    ivec2 first = shift >= 0 ? tile << shift : tile >> -shift;
    ivec2 last = shift >= 0 ? ((tile + 1) << shift) - 1 : first;
    first = max(first - region.rings, ivec2(0));
    last = min(last + region.rings, ivec2(region.cell_columns, region.cell_rows) - 1);
    uint found = 0u;
    for (int y = first.y; y <= last.y; ++y) {
        for (int x = first.x; x <= last.x; ++x) {
            found |= cells[region.cell_first + uint(y) * region.cell_columns + uint(x)];
        }
    }
    return found != 0u;
}

void main() {
    // A work group sees one region only: their flags start at multiples of its size.
    Region region = regions[region_of_group[gl_WorkGroupID.x]];
    uint place = gl_GlobalInvocationID.x - region.first;
    ivec2 tile = ivec2(place % region.columns, place / region.columns);
    bool is_there = place < region.tiles, found = is_there && near_a_hole(region, tile);
    if (is_there) active_tiles[gl_GlobalInvocationID.x] = uint(found);
    if (region.own_per_group > 0u) {
        uint slot = places_of_group(uint(found), region.own_list, region.own_per_group);
        if (found) entries[region.own_first + slot] = entry_of(tile, int(region.own_chain));
    }
    int chains = region.end_chain - region.first_chain;
    if (chains > 0) {
        uint slot = places_of_group(found ? uint(chains) : 0u, region.chains_list, 1u);
        for (int k = 0; found && k < chains; ++k)
            entries[region.chains_first + slot + uint(k)] = entry_of(tile, region.first_chain + k);
    }
}
