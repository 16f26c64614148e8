#version 430
// List the pixels that several quads cover, see who was reached by none, and clear the ranks for
// the next call.
// Twin: resolve() in reference.py. Change both or neither.

#constant COLUMNS
#constant ROWS    // work-group edge, pixels
#constant EXTEND  // whether unreached pixels are continued afterwards

layout(local_size_x = COLUMNS, local_size_y = ROWS) in;

#include "warp_mesh.glsl"
#include "warp_rank.glsl"

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, target_size))) return;
    int cell = cell_of(pixel);
    Rank found = ranks[cell];
    if ((found.claim & SHARED) != 0u) {
        entries[atomicAdd(shared_count, 1u)] = uint(cell);
        return;
    }
    ranks[cell].key = NOTHING;
    ranks[cell].claim = NO_CLAIM;
    if (found.key == NOTHING) {
        if (bool(EXTEND)) unreached = 1u;
        store(pixel, vec4(0.0), bool(EXTEND) ? 0.0 : INFINITE, vec2(0.0));
    }
}
