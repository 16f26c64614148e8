#version 430
// Tell which of the listed quads are stretched (torn apart, or in ring 0), and along which
// sides of a torn one the surface beyond reaches into it.
// Twin: torn_quads() and with_strips() in reference.py. Change both or neither.

#constant LANES       // work-group size
#constant SURFACE_PX  // sides in line that must stretch alike to be one surface

layout(local_size_x = LANES) in;

#include "warp_mesh.glsl"
#include "warp_rank.glsl"

uniform int stretch;  // sub-pixels; a longer side may be torn

ivec2 side_from(ivec2 pixel, ivec2 along) {
    return along * SUB + subpixels(imageLoad(flow_px, pixel + along).xy)
                       - subpixels(imageLoad(flow_px, pixel).xy);
}

// How many sides beyond `pixel` stretch like `side`, up to SURFACE_PX - 1.
int alike(ivec2 pixel, ivec2 along, ivec2 towards, ivec2 side) {
    ivec2 size = imageSize(depth_m);
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

bool torn(ivec2 first) {
    ivec2 right = ivec2(1, 0), down = ivec2(0, 1);
    return torn(first, right) || torn(first, down) || torn(first + down, right)
        || torn(first + right, down);
}

void main() {
    ivec2 mesh = mesh_size();
    uint stride = gl_NumWorkGroups.x * LANES;
    for (uint slot = gl_GlobalInvocationID.x; slot < large_count; slot += stride) {
        uint index = large[slot];
        ivec2 first = ivec2(int(index) % mesh.x, int(index) / mesh.x);
        if (in_ring_0(first)) {
            large[slot] = index | STRETCHED;
        } else if (torn(first)) {
            uint found = STRETCHED;
            for (int k = 0; k < 4; ++k) {
                ivec2 beyond = first + outwards(k);
                if (!in_ring_0(beyond) && drawable(load_quad(beyond, 0)) && !torn(beyond))
                    found |= STRIP << k;
            }
            large[slot] = index | found;
        }
    }
}
