#version 430
// Rank the quads that cover a few pixels, one per invocation; list those that cover many, or
// may be torn, for large.comp.glsl. A second dispatch takes those that contested a pixel.
// Twin: coverage() and nearest() in reference.py. Change both or neither.

#constant ROW          // work-group size, quads in a row
#constant MOST_GROUPS  // in a row of groups of the second dispatch
#constant SMALL        // target pixels in the bounding box of a quad drawn here, at most
#constant EXTEND       // whether ring 0 is drawn

layout(local_size_x = ROW) in;

#include "warp_mesh.glsl"
#include "warp_rank.glsl"

uniform int stretch;  // sub-pixels; a longer side may be torn

void main() {
    ivec2 mesh = mesh_size();
    uint quads = uint(mesh.x * mesh.y);
    ivec2 first = ivec2(gl_GlobalInvocationID.xy);
    if (round_index != 0) {
        uint slot = gl_WorkGroupID.y * MOST_GROUPS * ROW + gl_GlobalInvocationID.x;
        if (slot >= counts[CONTESTED_SMALL]) return;
        first = place_of(int(entries[quads - 1u - slot]), mesh.x);
    }
    if (any(greaterThanEqual(first, mesh))) return;
    bool ring = in_ring_0(first);
    if (ring && !bool(EXTEND)) return;
    Quad quad = load_quad(first, 0);
    if (!drawable(quad)) return;
    ivec2 low = lowest(quad), high = highest(quad);

    int side = max(max(longest(quad.b - quad.a), longest(quad.c - quad.b)),
                   max(longest(quad.d - quad.c), longest(quad.a - quad.d)));
    bool doubtful = side > stretch && !ring;
    // Pixels whose centres lie in the bounding box; what lies on its right or lower edge belongs
    // to the next. Strips of a torn quad reach beyond it.
    int reach = doubtful ? REACH : 0;
    ivec2 start = max((low - reach + SUB / 2 - 1) >> 8, ivec2(0));
    ivec2 last = min((high + reach - SUB / 2 - 1) >> 8, target_size - 1);
    ivec2 box = last - start + 1;
    if (any(lessThan(box, ivec2(1)))) return;

    bool few = max(box.x, box.y) <= SMALL && box.x * box.y <= SMALL
            && longest(high - low) <= NARROW;
    uint index = uint(first.y * mesh.x + first.x);
    bool listed = ring || doubtful || !few, contested = false;
    ivec2 pixel = start;
    int left = box.x * box.y;
    do {  // see large.comp.glsl
        if (listed) break;
        ivec2 centre = pixel * SUB + SUB / 2;
        Areas area = narrow_areas(quad.a - centre, quad.b - centre,
                                  quad.c - centre, quad.d - centre);
        if (rank(quad, area, index, false, pixel)) contested = true;
        ++pixel.x;
        if (pixel.x > last.x) pixel = ivec2(start.x, pixel.y + 1);
    } while (--left > 0);
    if (listed || contested) {
        uint slot = atomicAdd(counts[listed ? LARGE : CONTESTED_SMALL], 1u);
        entries[listed ? slot : quads - 1u - slot] = index;
    }
}
