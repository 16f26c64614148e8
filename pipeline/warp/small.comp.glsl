#version 430
// Rank the quads that cover a few pixels, one per invocation; list those that cover many, or
// may be torn, for large.comp.glsl.
// Twin: coverage() and nearest() in reference.py. Change both or neither.

#constant TILE    // work-group edge, quads
#constant SMALL   // target pixels in the bounding box of a quad drawn here, at most
#constant EXTEND  // whether ring 0 is drawn

layout(local_size_x = TILE, local_size_y = TILE) in;

#include "warp_mesh.glsl"
#include "warp_rank.glsl"

uniform int stretch;  // sub-pixels; a longer side may be torn

void main() {
    ivec2 first = ivec2(gl_GlobalInvocationID.xy);
    ivec2 mesh = mesh_size();
    if (any(greaterThanEqual(first, mesh))) return;
    bool ring = in_ring_0(first);
    if (ring && !bool(EXTEND)) return;
    Quad quad = load_quad(first);
    ivec2 low = min(min(quad.a, quad.b), min(quad.c, quad.d));
    ivec2 high = max(max(quad.a, quad.b), max(quad.c, quad.d));
    // Not drawn: what has a corner behind the camera or beyond the guard.
    if (any(lessThanEqual(quad.depth, vec4(0.0)))) return;
    if (any(lessThan(low, ivec2(-GUARD))) || any(greaterThan(high, ivec2(GUARD)))) return;

    // Pixels whose centres lie in the bounding box.
    ivec2 start = max((low + SUB / 2 - 1) >> 8, ivec2(0));
    ivec2 last = min((high - SUB / 2) >> 8, target_size - 1);
    ivec2 box = last - start + 1;
    if (any(lessThan(box, ivec2(1)))) return;

    int side = max(max(longest(quad.b - quad.a), longest(quad.c - quad.b)),
                   max(longest(quad.d - quad.c), longest(quad.a - quad.d)));
    bool few = max(box.x, box.y) <= SMALL && box.x * box.y <= SMALL
            && longest(high - low) <= NARROW;
    uint index = uint(first.y * mesh.x + first.x);
    if (ring || side > stretch || !few) {
        if (round_index == 0) large[atomicAdd(large_count, 1u)] = index;
        return;
    }
    for (int y = start.y; y <= last.y; ++y)
        for (int x = start.x; x <= last.x; ++x) {
            ivec2 centre = ivec2(x, y) * SUB + SUB / 2;
            Areas area = narrow_areas(quad.a - centre, quad.b - centre,
                                      quad.c - centre, quad.d - centre);
            rank(quad, area, index, false, ivec2(x, y));
        }
}
