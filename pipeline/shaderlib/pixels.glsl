// Visit the pixels of a list. Include it, write
//     void work(ivec2 pixel)
// and the main() below calls it for every listed pixel.

#include "lists.glsl"

layout(local_size_x = LIST_GROUP) in;

uniform uint list_index;
uniform uint list_first;
uniform ivec2 work_size;  // pixels of the resolution that the list is about

void work(ivec2 pixel);

void main() {
    uint step = gl_NumWorkGroups.x * uint(LIST_GROUP);
    for (uint item = gl_GlobalInvocationID.x; item < counts[list_index].w; item += step) {
        work(place_of(entries[list_first + item]));
    }
}
