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

// The same for those of 2x2 pixels whose bit is set: 1 for the first, 2 for the next in x, 4 for the
// one below, 8 for the last. Drivers take atomics thread by thread: one for four is faster.
void append_some(uint list, uint first, ivec2 corner, uint bits) {
    uint some = uint(bitCount(bits));
    if (some == 0u) return;
    uint slot = atomicAdd(counts[list].w, some);
    uint begun = (slot + uint(LIST_GROUP) - 1u) / uint(LIST_GROUP);  // the next work group
    if (begun * uint(LIST_GROUP) < slot + some) {
        if (begun < MOST_GROUPS) atomicAdd(counts[list].x, 1u);
        else if (begun % MOST_GROUPS == 0u) atomicAdd(counts[list].y, 1u);
    }
    uint at = first + slot, entry = entry_of(corner, 0);
    if ((bits & 1u) != 0u) entries[at++] = entry;
    if ((bits & 2u) != 0u) entries[at++] = entry + 1u;
    if ((bits & 4u) != 0u) entries[at++] = entry + (1u << 14);
    if ((bits & 8u) != 0u) entries[at] = entry + 1u + (1u << 14);
}

// No loop over groups: see guided.glsl.
uint group_at_hand() { return gl_WorkGroupID.y * MOST_GROUPS + gl_WorkGroupID.x; }

void append(uint list, uint first, ivec2 pixel, int chain) {
    add(list, first, entry_of(pixel, chain), uint(LIST_GROUP));
}
