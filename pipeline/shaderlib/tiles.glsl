// Visit the tiles of a list. Include it, write
//     void work(ivec2 pixel)
// and the main() below calls it for every pixel of every listed tile, borders excepted.

#constant TILE  // work-group edge, pixels

#include "lists.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform uint list_index;
uniform uint list_first;
uniform ivec2 work_size;  // pixels of the resolution that the tiles divide

void work(ivec2 pixel);

void main() {
    for (uint item = gl_WorkGroupID.x; item < counts[list_index].w; item += gl_NumWorkGroups.x) {
        ivec2 tile = place_of(entries[list_first + item]);
        ivec2 pixel = TILE * tile + ivec2(gl_LocalInvocationID.xy);
        if (all(lessThan(pixel, work_size))) work(pixel);
    }
}
