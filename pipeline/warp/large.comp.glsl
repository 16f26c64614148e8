#version 430
// Rank the quads that cover many pixels, one per work group: rows side by side, and several
// invocations along each row. A fixed number of groups empties the list.
// Twin: coverage() and nearest() in reference.py. Change both or neither.

#constant LANES  // work-group size, a power of two
#constant HIDE   // whether stretched quads are left out, but for the surfaces that reach into them
#constant SMEAR  // whether they are drawn like any other

layout(local_size_x = LANES) in;

#include "warp_mesh.glsl"
#include "warp_rank.glsl"

// Widen the span of pixels in row y (sub-pixels) by where an edge crosses it. Rounding is
// below a pixel (2^-22 of 2^23 sub-pixels), and the span gets one more on each side.
void cross_edge(ivec2 from, ivec2 to, int y, inout vec2 span) {
    if (y < min(from.y, to.y) || y > max(from.y, to.y)) return;
    float share = from.y == to.y ? 0.0 : float(y - from.y) / float(to.y - from.y);
    float x = float(from.x) + share * float(to.x - from.x);
    span = vec2(min(span.x, x), max(span.y, x));
    if (from.y == to.y) span = vec2(min(span.x, float(to.x)), max(span.y, float(to.x)));
}

// Tells whether it contested a pixel.
bool draw(Quad quad, uint quad_part, bool stretched) {
    int lane = int(gl_LocalInvocationIndex);
    ivec2 lowest_at = lowest(quad), highest_at = highest(quad);
    // Pixels outside the quad may be tried: one more on each side.
    bool narrow = longest(highest_at - lowest_at) <= NARROW - 4 * SUB;
    int low = max((lowest_at.y + SUB / 2 - 1) >> 8, 0);
    int high = min((highest_at.y - SUB / 2 - 1) >> 8, target_size.y - 1);
    int rows = 1;  // at once
    while (rows < LANES && rows < high - low + 1) rows *= 2;
    int across = LANES / rows;
    bool contested = false;
    // Loops test at their ends: where they test first, llvmpipe runs them once too often.
    int y = low + lane / across;
    do {
        int centre = y * SUB + SUB / 2;
        vec2 span = vec2(2.0 * GUARD, -2.0 * GUARD);
        cross_edge(quad.a, quad.b, centre, span);
        cross_edge(quad.b, quad.c, centre, span);
        cross_edge(quad.c, quad.d, centre, span);
        cross_edge(quad.d, quad.a, centre, span);
        cross_edge(quad.a, quad.c, centre, span);
        ivec2 pixels = ivec2(floor(span / float(SUB)));
        int left = max(pixels.x - 1, 0), right = min(pixels.y + 1, target_size.x - 1);
        int x = left + lane % across;
        do {
            if (x > right || y > high) break;
            ivec2 at = ivec2(x, y) * SUB + SUB / 2;
            ivec2 a = quad.a - at, b = quad.b - at, c = quad.c - at, d = quad.d - at;
            Areas area;
            if (narrow) area = narrow_areas(a, b, c, d);
            else area = wide_areas(a, b, c, d);
            if (rank(quad, area, quad_part, stretched, ivec2(x, y))) contested = true;
            x += across;
        } while (x <= right);
        y += rows;
    } while (y <= high);
    return contested;
}

void main() {
    ivec2 mesh = mesh_size();
    for (uint slot = gl_WorkGroupID.x; slot < counts[LARGE]; slot += gl_NumWorkGroups.x) {
        uint found = parts[slot];
        if (round_index != 0 && (found & CONTESTED) == 0u) continue;
        uint index = entries[slot];
        bool stretched = (found & TORN) != 0u && !bool(SMEAR);
        uint shown = found & (TORN - 1u);
        if (bool(SMEAR)) shown = 1u;
        else if (bool(HIDE) && stretched) shown &= ~1u;
        ivec2 first = place_of(int(index), mesh.x);
        bool contested = false;
        // Strips before the quad that they lie on, which then does not contest their pixels.
        do {
            if (shown == 0u) break;
            int part = findMSB(shown);
            shown ^= 1u << part;
            if (draw(load_quad(first, part), index + uint(part) * uint(mesh.x * mesh.y),
                     stretched && part == 0))
                contested = true;
        } while (shown != 0u);
        if (contested) atomicOr(parts[slot], CONTESTED);
    }
}
