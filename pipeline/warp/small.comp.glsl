#version 430
// Rank the quads that cover a few pixels, one per invocation; put the others on a list.
// Twin: ranks() in reference.py. Change both or neither.

#constant TILE        // work-group edge, quads
#constant SMALL       // target pixels in the bounding box of a quad drawn here, at most
#constant TEAR        // whether torn quads show the background, not what they tie together
#constant EXTEND      // whether ring 0 is drawn
#constant SURFACE_PX  // sides in a row that must stretch alike to be one surface

layout(local_size_x = TILE, local_size_y = TILE) in;

#include "warp_mesh.glsl"
#include "warp_rank.glsl"

uniform int stretch;  // sub-pixels; a longer side may be torn

bool in_ring_0(ivec2 first) {
    return any(equal(first, ivec2(0))) || any(equal(first, mesh_size() - 1));
}

int longest(ivec2 v) { return max(abs(v.x), abs(v.y)); }

ivec2 side_from(ivec2 pixel, ivec2 along) {
    return along * SUB + displacement(pixel + along) - displacement(pixel);
}

// How many sides beyond `pixel` stretch like `side`, up to SURFACE_PX - 1.
int alike(ivec2 pixel, ivec2 along, ivec2 towards, ivec2 side) {
    ivec2 size = textureSize(depth_m, 0);
    int count = 0;
    for (; count < SURFACE_PX - 1; ++count) {
        pixel += towards;
        if (any(lessThan(pixel, ivec2(0))) || any(greaterThanEqual(pixel + along, size))) break;
        if (2 * longest(side_from(pixel, along) - side) > longest(side)) break;
    }
    return count;
}

// Whether the side from this vertex to the next ties two surfaces together: it is long, and
// too few of its neighbours in line stretch alike.
bool torn(ivec2 vertex, ivec2 along) {
    ivec2 pixel = pixel_of(vertex);
    if (pixel_of(vertex + along) == pixel) return false;
    ivec2 side = side_from(pixel, along);
    if (longest(side) <= stretch) return false;
    return 1 + alike(pixel, along, along, side) + alike(pixel, along, -along, side) < SURFACE_PX;
}

bool is_stretched(ivec2 first, Quad quad) {
    if (in_ring_0(first)) return true;
#if TEAR
    if (longest(quad.b - quad.a) > stretch && torn(first, ivec2(1, 0))) return true;
    if (longest(quad.c - quad.d) > stretch && torn(first + ivec2(0, 1), ivec2(1, 0))) return true;
    if (longest(quad.d - quad.a) > stretch && torn(first, ivec2(0, 1))) return true;
    if (longest(quad.c - quad.b) > stretch && torn(first + ivec2(1, 0), ivec2(0, 1))) return true;
#endif
    return false;
}

void main() {
    ivec2 first = ivec2(gl_GlobalInvocationID.xy);
    ivec2 mesh = mesh_size();
    if (any(greaterThanEqual(first, mesh))) return;
#if !EXTEND
    if (in_ring_0(first)) return;
#endif
    Quad quad = load_quad(first);
    if (!quad.drawable) return;

    // Pixels whose centres lie in the bounding box.
    ivec2 low = min(min(quad.a, quad.b), min(quad.c, quad.d));
    ivec2 high = max(max(quad.a, quad.b), max(quad.c, quad.d));
    low = max((low + SUB / 2 - 1) >> 8, ivec2(0));
    high = min((high - SUB / 2) >> 8, target_size - 1);
    if (any(greaterThan(low, high))) return;

    bool stretched = is_stretched(first, quad);
#if TEAR && !EXTEND
    if (stretched) return;
#endif
    uint index = uint(first.y * mesh.x + first.x);
    ivec2 box = high - low + 1;
    if (box.x > SMALL || box.x * box.y > SMALL) {
        if (round_index == 0) large[atomicAdd(large_count, 1u)] = index | (stretched ? STRETCHED : 0u);
        return;
    }
    for (int y = low.y; y <= high.y; ++y)
        for (int x = low.x; x <= high.x; ++x)
            rank(quad, index, stretched, ivec2(x, y));
}
