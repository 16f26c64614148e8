#version 430
// Show at every pixel that several quads cover who won it.
// Twin: resolve() in reference.py. Change both or neither.

#constant LANES  // work-group size

layout(local_size_x = LANES) in;

#include "warp_mesh.glsl"
#include "warp_rank.glsl"

void mend(ivec2 pixel) {
    int cell = cell_of(pixel);
    uint claim = ranks[cell].claim & NO_CLAIM;
    bool stretched = (ranks[cell].key & STRETCHED) != 0u;
    ranks[cell].key = NOTHING;
    ranks[cell].claim = NO_CLAIM;
    ivec2 mesh = mesh_size();
    uint quads = uint(mesh.x * mesh.y);
    int part = int(claim / quads);
    ivec2 first = place_of(int(claim - uint(part) * quads), mesh.x);
    Quad quad = load_quad(first, part);
    if (stretched) {
        show_hole(pixel, quad);
        return;
    }
    ivec2 centre = pixel * SUB + SUB / 2;
    ivec2 a = quad.a - centre, b = quad.b - centre, c = quad.c - centre, d = quad.d - centre;
    Areas area;
    if (max(max(longest(a), longest(b)), max(longest(c), longest(d))) <= NARROW)
        area = narrow_areas(a, b, c, d);
    else
        area = wide_areas(a, b, c, d);
    vec2 weight;
    bool upper;
    covers(quad, area, weight, upper);
    show_surface(pixel, quad, first, part, weight, upper);
}

void main() {
    uint stride = gl_NumWorkGroups.x * LANES;
    for (uint slot = gl_GlobalInvocationID.x; slot < shared_count; slot += stride)
        mend(place_of(int(entries[slot]), target_size.x));
}
