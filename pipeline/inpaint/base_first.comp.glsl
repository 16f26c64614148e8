#version 430
// First pull of the base: known colour, 2x2 into one, with depth as the guide. It reads the
// whole frame, so it marks every cell, at every resolution, that holds a hole pixel as well.
// Twin: guided_base() and near_a_hole() in reference.py. Change both or neither.

#constant TILE         // work-group edge, pixels
#constant CELL         // edge of a cell of resolution 0, pixels
#constant RESOLUTIONS  // how many resolutions of cells there are

#include "guided.glsl"
#include "lists.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

layout(rgba32f, binding = 0) uniform readonly image2D image;  // rgb: encoded; a: 1 known, 0 hole
layout(r32f, binding = 1) uniform readonly image2D depth_m;   // background's inside holes
layout(std430, binding = 0) writeonly buffer Cells { uint cells[]; };
layout(std430, binding = 4) writeonly buffer Coarse { vec4 coarse[]; };
layout(std430, binding = 6) writeonly buffer CoarseGuide { float coarse_guide[]; };

uniform float z_near_m;
uniform uvec2 first_and_columns[RESOLUTIONS];
uniform uvec2 holes_list;       // index and first entry: 2x2 blocks with a hole pixel
uniform uvec2 incomplete_list;  // the same for what push has to complete

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    ivec2 size = imageSize(image);
    ivec2 a = 2 * pixel;
    if (any(greaterThanEqual(a, size))) return;
    ivec2 d = min(a + 1, size - 1);
    ivec2 b = ivec2(d.x, a.y);
    ivec2 c = ivec2(a.x, d.y);
    vec4 colour_a = imageLoad(image, a), colour_b = imageLoad(image, b);
    vec4 colour_c = imageLoad(image, c), colour_d = imageLoad(image, d);
    vec4 validity = step(0.5, vec4(colour_a.a, colour_b.a, colour_c.a, colour_d.a));
    vec4 depth = vec4(imageLoad(depth_m, a).r, imageLoad(depth_m, b).r, imageLoad(depth_m, c).r,
                      imageLoad(depth_m, d).r);
    vec4 guide = max(vec4(0.0), 1.0 - z_near_m / depth);
    float deepest = farthest(guide);
    Pull p = pull_shares(validity, guide, deepest);
    vec4 parent = mixed(p.share, colour_a, colour_b, colour_c, colour_d);
    int place = pixel.y * ((size.x + 1) / 2) + pixel.x;
    coarse[place] = vec4(parent.rgb, p.confidence);
    coarse_guide[place] = deepest;

    if (p.confidence < 1.0) append(incomplete_list.x, incomplete_list.y, pixel);
    if (dot(validity, vec4(1.0)) < 4.0) {
        append(holes_list.x, holes_list.y, pixel);
        // Neighbours may write the same cell; all write the same value.
        uvec2 cell = uvec2(a / CELL);
        for (int r = 0; r < RESOLUTIONS; ++r) {
            uvec2 at = cell >> r;
            cells[first_and_columns[r].x + at.y * first_and_columns[r].y + at.x] = 1u;
        }
    }
}
