// Work lists, shared by all passes of a fill: which tiles or pixels to visit.

#define LIST_GROUP 64      // pixels of a list that one work group visits
#define MOST_GROUPS 32768u  // every driver takes that many; the rest are looped over

layout(std430, binding = 1) buffer Counts { uvec4 counts[]; };  // groups x, y, z; entries
layout(std430, binding = 2) buffer Entries { uint entries[]; };  // x + (y << 16)

uint entry_of(ivec2 place) { return uint(place.x) + (uint(place.y) << 16); }

ivec2 place_of(uint entry) { return ivec2(entry & 0xffffu, entry >> 16); }

// Puts a pixel into a list that a later pass will visit. Order varies, results do not.
void append(uint list, uint first, ivec2 pixel) {
    uint slot = atomicAdd(counts[list].w, 1u);
    entries[first + slot] = entry_of(pixel);
    if (slot % uint(LIST_GROUP) == 0u && slot / uint(LIST_GROUP) < MOST_GROUPS) atomicAdd(counts[list].x, 1u);
}
