#version 430
// Tell which of the listed quads are stretched (torn apart, or in ring 0), along which sides of
// a torn one the surface beyond reaches into it, and what is one pixel thin there.
// Twin: torn_quads(), with_strips(), with_thin() and thin_and_mixed() in reference.py.
// Change both or neither.

#constant LANES        // work-group size
#constant ROW          // of small.comp.glsl, whose second dispatch is sized here
#constant MOST_GROUPS  // the same
#constant SURFACE_PX   // sides in line that must stretch alike to be one surface

layout(local_size_x = LANES) in;

#include "warp_mesh.glsl"
#include "warp_rank.glsl"

uniform int stretch;  // sub-pixels; a longer side may be torn

ivec2 side_from(ivec2 pixel, ivec2 along) {
    return along * SUB + subpixels(imageLoad(flow_px, pixel + along).xy)
                       - subpixels(imageLoad(flow_px, pixel).xy);
}

// Number of sides beyond `pixel` that stretch like `side`, up to SURFACE_PX - 1.
int alike(ivec2 pixel, ivec2 along, ivec2 towards, ivec2 side) {
    ivec2 size = imageSize(depth_m);
    int count = 0;
    for (; count < SURFACE_PX - 1; ++count) {
        pixel += towards;
        if (any(lessThan(min(pixel, pixel + along), ivec2(0)))
            || any(greaterThanEqual(max(pixel, pixel + along), size))) break;
        if (2 * longest(side_from(pixel, along) - side) > longest(side)) break;
    }
    return count;
}

// True if the side from this vertex to the next ties two surfaces together: it is long, and
// too few of its neighbours in line stretch alike.
bool torn(ivec2 vertex, ivec2 along) {
    ivec2 pixel = pixel_of(vertex);
    if (pixel_of(vertex + along) != pixel + along) return false;
    ivec2 side = side_from(pixel, along);
    if (longest(side) <= stretch) return false;
    return 1 + alike(pixel, along, along, side) + alike(pixel, along, -along, side) < SURFACE_PX;
}

bool torn(ivec2 first) {
    ivec2 right = ivec2(1, 0), down = ivec2(0, 1);
    return torn(first, right) || torn(first, down) || torn(first + down, right)
        || torn(first + right, down);
}

// Kind of a vertex along one line of pixels: a thing of its own (THIN), or in between two others
// (MIXED); 0 if not both sides are torn.
const uint THIN = 1u, MIXED = 2u;

uint kind(ivec2 vertex, ivec2 along) {
    if (!torn(vertex - along, along) || !torn(vertex, along)) return 0u;
    ivec2 pixel = pixel_of(vertex);
    ivec2 here = subpixels(imageLoad(flow_px, pixel).xy);
    ivec2 before = here - subpixels(imageLoad(flow_px, pixel - along).xy);
    ivec2 after = subpixels(imageLoad(flow_px, pixel + along).xy) - here;
    float own = imageLoad(depth_m, pixel).x;
    float first = imageLoad(depth_m, pixel - along).x, last = imageLoad(depth_m, pixel + along).x;
    bool within = min(first, last) <= own && own <= max(first, last);
    return within && longest(before + after) > max(longest(before), longest(after)) ? MIXED : THIN;
}

// The same along a row, a column and both diagonals. Vertices beyond the source are mixed.
uint kind(ivec2 vertex) {
    if (any(lessThan(vertex, ivec2(RINGS)))) return MIXED;
    if (any(greaterThanEqual(vertex, imageSize(depth_m) + RINGS))) return MIXED;
    uint found = 0u;
    for (int k = 0; k < 4; ++k)
        found |= kind(vertex, k == 0 ? ivec2(1, 0) : ivec2(k - 2, 1));
    return (found & MIXED) != 0u ? MIXED : found;
}

// Bit k + 1 for a strip along side k, BAND and SPECK for what is thin.
uint parts_of_torn(ivec2 first) {
    uint found = 0u;
    uint torn_beyond = 0u;  // a bit for each side
    for (int k = 0; k < 4; ++k) {
        ivec2 beyond = first + outwards(k);
        if (in_ring_0(beyond) || !drawable(load_quad(beyond, 0))) continue;
        if (torn(beyond)) torn_beyond |= 1u << k;
        else found |= 2u << k;
    }
    bool above = (torn_beyond & 1u) != 0u, before = (torn_beyond & 8u) != 0u;
    if (!above && !before) return found;
    uint own = kind(first);
    if (own == MIXED) return found;
    ivec2 right = ivec2(1, 0), down = ivec2(0, 1), corner = first - right - down;
    // One loop, so that the judgement stands in the program once: it is long.
    for (int k = 0; k < 2; ++k) {
        ivec2 along = k == 0 ? right : down;
        bool beyond = k == 0 ? above : before;
        if (beyond && !torn(first, along) && (own | kind(first + along)) == THIN)
            found |= 1u << (BAND + k);
    }
    if (own == THIN && above && before && !in_ring_0(corner) && drawable(load_quad(corner, 0))
        && torn(corner))
        found |= 1u << SPECK;
    return found;
}

void main() {
    if (gl_GlobalInvocationID.x == 0u) {
        uint groups = (counts[CONTESTED_SMALL] + ROW - 1u) / ROW;
        contested_groups =
            uvec3(min(groups, MOST_GROUPS), (groups + MOST_GROUPS - 1u) / MOST_GROUPS, 1u);
    }
    ivec2 mesh = mesh_size();
    uint stride = gl_NumWorkGroups.x * LANES;
    for (uint slot = gl_GlobalInvocationID.x; slot < counts[LARGE]; slot += stride) {
        uint index = entries[slot];
        ivec2 first = place_of(int(index), mesh.x);
        uint found = 1u;
        if (in_ring_0(first)) found = 1u | TORN;
        else if (torn(first)) found = 1u | TORN | parts_of_torn(first);
        parts[slot] = found;
    }
}
