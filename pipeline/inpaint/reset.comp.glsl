#version 430
// Reset: forget the last frame's cells and lists.

layout(local_size_x = 64) in;

layout(std430) writeonly buffer Cells { uint cells[]; };
layout(std430) writeonly buffer Counts { uvec4 counts[]; };  // groups x, y, z; entries

uniform uint cell_count;
uniform uint list_count;

void main() {
    uint item = gl_GlobalInvocationID.x;
    if (item < cell_count) cells[item] = 0u;
    if (item < list_count) counts[item] = uvec4(0u, 1u, 1u, 0u);
}
