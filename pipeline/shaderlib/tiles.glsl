// Work lists: visit only the tiles that regions.gpu listed. Include it, write
//     void work(ivec2 pixel)
// and the main() below calls it for every pixel of every listed tile, borders excepted.

#constant TILE  // work-group edge, pixels

layout(local_size_x = TILE, local_size_y = TILE) in;

layout(std430, binding = 1) readonly buffer Counts { uvec4 counts[]; };  // w: tiles in the list
layout(std430, binding = 2) readonly buffer Entries { uint entries[]; };  // x + (y << 16)
layout(std430, binding = 3) readonly buffer Active { uint active_tiles[]; };

uniform uint list_index;
uniform uint list_first;
uniform ivec2 work_size;  // pixels of the resolution that this pass writes

void work(ivec2 pixel);

bool is_active(uint first, uint columns, ivec2 tile) {
    return active_tiles[first + uint(tile.y) * columns + uint(tile.x)] != 0u;
}

void main() {
    for (uint item = gl_WorkGroupID.x; item < counts[list_index].w; item += gl_NumWorkGroups.x) {
        uint entry = entries[list_first + item];
        ivec2 tile = ivec2(entry & 0xffffu, entry >> 16);
        ivec2 pixel = TILE * tile + ivec2(gl_LocalInvocationID.xy);
        if (all(lessThan(pixel, work_size))) work(pixel);
    }
}
