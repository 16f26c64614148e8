// Visit the pixels of a list. Include it, write
//     void work(ivec2 pixel, int chain)
// and the main() below calls it for every listed pixel.

#include "lists.glsl"

layout(local_size_x = LIST_GROUP) in;

layout(std140) uniform Visit {
    uint list_index;
    uint list_first;
    ivec2 work_size;  // pixels of the resolution that the list is about
};

void work(ivec2 pixel, int chain);

void main() {
    uint item = group_at_hand() * uint(LIST_GROUP) + gl_LocalInvocationID.x;
    if (item >= entries_in(list_index)) return;
    uint entry = entries[place_in(list_first, item)];
    work(place_of(entry), chain_of(entry));
}
