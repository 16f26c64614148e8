// Work lists, shared by all passes of a fill: which tiles or pixels of which chain to visit.

#define LIST_GROUP 64       // pixels of a list that one work group visits
#define MOST_GROUPS 32768u  // in a row of work groups: every driver takes that many

layout(std430, binding = 1) buffer Counts { uvec4 counts[]; };  // groups x, y, z; entries
layout(std430, binding = 2) buffer Entries { uint entries[]; };  // x + (y << 14) + (chain << 28)

uint entry_of(ivec2 place, int chain) {
    return uint(place.x) + (uint(place.y) << 14) + (uint(chain) << 28);
}

ivec2 place_of(uint entry) { return ivec2(entry & 0x3fffu, (entry >> 14) & 0x3fffu); }

int chain_of(uint entry) { return int(entry >> 28); }

// Puts an entry into a list that a later pass will visit, so many with each work group. Order
// varies, results do not.
void add(uint list, uint first, uint entry, uint per_group) {
    uint slot = atomicAdd(counts[list].w, 1u);
    entries[first + slot] = entry;
    uint group = slot / per_group;
    if (slot % per_group != 0u) return;
    if (group < MOST_GROUPS) atomicAdd(counts[list].x, 1u);
    else if (group % MOST_GROUPS == 0u) atomicAdd(counts[list].y, 1u);
}

// No loop over groups: see guided.glsl.
uint group_at_hand() { return gl_WorkGroupID.y * MOST_GROUPS + gl_WorkGroupID.x; }

void append(uint list, uint first, ivec2 pixel, int chain) {
    add(list, first, entry_of(pixel, chain), uint(LIST_GROUP));
}
