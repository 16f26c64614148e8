#version 430
// Cells: mark every cell, at every resolution, that holds a hole pixel.
// Twin: near_a_hole() in reference.py, its first half.

#constant CELL         // edge of a cell of resolution 0, pixels
#constant RESOLUTIONS  // how many resolutions of cells there are

layout(local_size_x = 8, local_size_y = 8) in;

layout(rgba32f, binding = 0) uniform readonly image2D image;  // a: 1 known, 0 hole
layout(std430, binding = 0) writeonly buffer Cells { uint cells[]; };

uniform uvec2 first_and_columns[RESOLUTIONS];

void main() {
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy);
    ivec2 size = imageSize(image);
    ivec2 start = CELL * cell;
    if (any(greaterThanEqual(start, size))) return;
    ivec2 end = min(start + CELL, size);

    float least = 1.0;
    for (int y = start.y; y < end.y; ++y) {
        for (int x = start.x; x < end.x; ++x) least = min(least, imageLoad(image, ivec2(x, y)).a);
    }
    if (least >= 0.5) return;
    // Neighbours may write the same cell; all write the same value.
    for (int r = 0; r < RESOLUTIONS; ++r) {
        uvec2 place = uvec2(cell) >> r;
        cells[first_and_columns[r].x + place.y * first_and_columns[r].y + place.x] = 1u;
    }
}
