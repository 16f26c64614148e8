// Work lists, shared by all passes of a fill: which tiles or pixels of which chain to visit.

#constant SOFTWARE  // 1: a processor draws

#define LIST_GROUP 64       // pixels of a list that one work group visits
#define MOST_GROUPS 32768u  // in a row of work groups: every driver takes that many

#define DOWNWARDS 0x80000000u  // in a list's first entry: the others lie below it, not above

layout(std430) buffer Counts { uint counts[]; };  // of a list: groups x, y, z; entries
layout(std430) buffer Entries { uint entries[]; };  // x + (y << 14) + (chain << 28)

uint entry_of(ivec2 place, int chain) {
    return uint(place.x) + (uint(place.y) << 14) + (uint(chain) << 28);
}

ivec2 place_of(uint entry) { return ivec2(entry & 0x3fffu, (entry >> 14) & 0x3fffu); }

int chain_of(uint entry) { return int(entry >> 28); }

uint place_in(uint first, uint slot) {
    return (first & DOWNWARDS) == 0u ? first + slot : (first ^ DOWNWARDS) - slot;
}

uint entries_in(uint list) { return counts[4u * list + 3u]; }

// Takes places for `some` entries, so many to a work group of the pass that will visit them, and
// says which is the first. Order varies, results do not. Drivers take atomics thread by thread: few
// are faster.
uint places_for(uint some, uint list, uint per_group) {
    uint slot = atomicAdd(counts[4u * list + 3u], some);
    uint group = (slot + per_group - 1u) / per_group;                // the next to begin,
    uint end = max(group, (slot + some + per_group - 1u) / per_group);  // and what it will be
    uint columns = min(end, MOST_GROUPS) - min(group, MOST_GROUPS);
    uint rows = (max(end, 1u) - 1u) / MOST_GROUPS - (max(group, 1u) - 1u) / MOST_GROUPS;
    if (columns > 0u) atomicAdd(counts[4u * list], columns);
    if (rows > 0u) atomicAdd(counts[4u * list + 1u], rows);
    return slot;
}

shared uint group_some, group_first;

// Takes places for the `some` entries of each invocation of a work group, all of which must call it, and
// says which is its first: by one atomic, for cards take those of one address in turn. A processor does
// not, and barriers cost it more.
uint places_of_group(uint some, uint list, uint per_group) {
#if SOFTWARE
    return some > 0u ? places_for(some, list, per_group) : 0u;
#else
    bool is_first = gl_LocalInvocationIndex == 0u;
    if (is_first) group_some = 0u;
    barrier();
    uint own = some > 0u ? atomicAdd(group_some, some) : 0u;
    barrier();
    if (is_first && group_some > 0u) group_first = places_for(group_some, list, per_group);
    barrier();
    return group_first + own;
#endif
}

// Puts an entry into a list.
void add(uint list, uint first, uint entry, uint per_group) {
    entries[place_in(first, places_for(1u, list, per_group))] = entry;
}

void append(uint list, uint first, ivec2 pixel, int chain) {
    add(list, first, entry_of(pixel, chain), uint(LIST_GROUP));
}

// Bits of 2x2 pixels: 1 for the first, 2 for the next in x, 4 for the one below, 8 for the last.
uint bits(bool a, bool b, bool c, bool d) {
    return uint(a) + 2u * uint(b) + 4u * uint(c) + 8u * uint(d);
}

// Writes those of 2x2 pixels whose bit is set, from a place on.
void write_some(uint at, ivec2 corner, int chain, uint bits) {
    uint entry = entry_of(corner, chain);
    if ((bits & 1u) != 0u) entries[at++] = entry;
    if ((bits & 2u) != 0u) entries[at++] = entry + 1u;
    if ((bits & 4u) != 0u) entries[at++] = entry + (1u << 14);
    if ((bits & 8u) != 0u) entries[at] = entry + 1u + (1u << 14);
}

void append_some(uint list, uint first, ivec2 corner, int chain, uint bits) {
    if (bits == 0u) return;
    write_some(first + places_for(uint(bitCount(bits)), list, uint(LIST_GROUP)), corner, chain, bits);
}

// No loop over groups: see guided.glsl.
uint group_at_hand() { return gl_WorkGroupID.y * MOST_GROUPS + gl_WorkGroupID.x; }
