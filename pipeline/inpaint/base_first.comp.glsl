#version 430
// First two pulls of the base: known colour, 2x2 into one and 4x4 into one, with depth as the
// guide. They read the whole frame, so they mark every cell, at every resolution, that holds a
// hole pixel as well.
// Twin: guided_base() and near_a_hole() in reference.py. Change both or neither.

#constant CELL         // edge of a cell of resolution 0, pixels
#constant RESOLUTIONS  // how many resolutions of cells there are

#include "guided.glsl"
#include "lists.glsl"

// A row of blocks: rows are read on and on (8x8 of them take half as long again).
layout(local_size_x = LIST_GROUP) in;

layout(rgba32f) uniform readonly image2D image;  // rgb: encoded; a: 1 known, 0 hole
layout(r32f) uniform readonly image2D depth_m;   // background's inside holes
layout(rgba32f) uniform writeonly image2D halves;  // of 2x2
layout(r32f) uniform writeonly image2D half_guide;
layout(rgba32f) uniform writeonly image2D quarters;  // of 4x4
layout(r32f) uniform writeonly image2D quarter_guide;
layout(rg32f) uniform writeonly image2D extents;  // of 4x4: least, largest guide
layout(std430) writeonly buffer Cells { uint cells[]; };

uniform float z_near_m;
uniform uvec2 first_and_columns[RESOLUTIONS];
uniform uvec2 holes_list;  // index and first entry: 2x2 blocks with a hole pixel
uniform uvec2 half_list;   // the same for what push has to complete
uniform uvec2 quarter_list;

struct Texel {
    vec4 colour;  // a: confidence
    float guide;    // the farthest of 2x2
    float nearest;
    bool hole;
    bool there;  // in the frame, and no last one repeated
};

// A block of 4x4 pixels lies in one cell.
void mark_hole(ivec2 pixel) {
    // Neighbours may write the same cell; all write the same value.
    uvec2 cell = uvec2(pixel / CELL);
    for (int r = 0; r < RESOLUTIONS; ++r) {
        uvec2 at = cell >> r;
        cells[first_and_columns[r].x + at.y * first_and_columns[r].y + at.x] = 1u;
    }
}

Texel half_texel(ivec2 pixel) {
    ivec2 last = imageSize(image) - 1;
    ivec2 a = 2 * pixel, d = min(a + 1, last);
    bool there = all(lessThanEqual(a, last));
    ivec2 b = ivec2(d.x, a.y), c = ivec2(a.x, d.y);
    vec4 colour_a = imageLoad(image, a), colour_b = imageLoad(image, b);
    vec4 colour_c = imageLoad(image, c), colour_d = imageLoad(image, d);
    vec4 validity = step(0.5, vec4(colour_a.a, colour_b.a, colour_c.a, colour_d.a));
    vec4 depth = vec4(imageLoad(depth_m, a).r, imageLoad(depth_m, b).r, imageLoad(depth_m, c).r,
                      imageLoad(depth_m, d).r);
    vec4 guide = max(vec4(0.0), 1.0 - z_near_m / depth);
    float deepest = farthest(guide);
    Pull p = pull_shares(validity, guide, deepest);
    vec3 colour = mixed(p.share, colour_a, colour_b, colour_c, colour_d).rgb;
    bool hole = dot(validity, vec4(1.0)) < 4.0;
    Texel texel = Texel(vec4(colour, p.confidence), deepest, nearest(guide), hole, there);
    if (there) {
        imageStore(halves, pixel, texel.colour);
        imageStore(half_guide, pixel, vec4(deepest));
    }
    return texel;
}

bool incomplete(Texel texel) { return texel.there && texel.colour.a < 1.0; }

// Marks of what goes into the lists: bits of 2x2, and 1 or 0.
struct Found { uint holes, halves, quarter; };

Found pulled(ivec2 pixel) {
    Found found;
    Texel a = half_texel(2 * pixel), b = half_texel(2 * pixel + ivec2(1, 0));
    Texel c = half_texel(2 * pixel + ivec2(0, 1)), d = half_texel(2 * pixel + 1);
    found.halves = bits(incomplete(a), incomplete(b), incomplete(c), incomplete(d));
    found.holes = bits(a.hole && a.there, b.hole && b.there, c.hole && c.there, d.hole && d.there);
    // An odd border repeats its last texel.
    bvec2 whole = lessThan(4 * pixel + 2, imageSize(image));
    if (!whole.x) { b = a; d = c; }
    if (!whole.y) { c = a; d = b; }
    vec4 guide = vec4(a.guide, b.guide, c.guide, d.guide);
    float deepest = farthest(guide);
    Pull p = pull_shares(vec4(a.colour.a, b.colour.a, c.colour.a, d.colour.a), guide, deepest);
    vec3 colour = mixed(p.share, a.colour, b.colour, c.colour, d.colour).rgb;
    imageStore(quarters, pixel, vec4(colour, p.confidence));
    imageStore(quarter_guide, pixel, vec4(deepest));
    float least = nearest(vec4(a.nearest, b.nearest, c.nearest, d.nearest));
    imageStore(extents, pixel, vec4(least, deepest, 0.0, 0.0));
    found.quarter = uint(p.confidence < 1.0);
    if (a.hole || b.hole || c.hole || d.hole) mark_hole(4 * pixel);
    return found;
}

void append_found(uvec2 list, ivec2 corner, uint bits) {
    uint slot = places_of_group(uint(bitCount(bits)), list.x, uint(LIST_GROUP));
    write_some(list.y + slot, corner, 0, bits);
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    Found found = Found(0u, 0u, 0u);
    if (all(lessThan(4 * pixel, imageSize(image)))) found = pulled(pixel);
    append_found(half_list, 2 * pixel, found.halves);
    append_found(holes_list, 2 * pixel, found.holes);
    append_found(quarter_list, pixel, found.quarter);
}
