#version 430
// Unfold: colour in polar cells, read at the picture's pixels. Twin: from_cells() in grid.py.

#constant TILE     // work-group edge, pixels
#constant TURN_PX  // where cells begin to grow
#constant START_PX
#constant KNEE_PX  // times the radius: columns per pixel; also rows per radian

#include "polar.glsl"
#include "cubic.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform sampler2D cells;  // columns are angles, rows radii
layout(rgba32f) uniform writeonly image2D picture;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(picture)))) return;
    vec2 polar = polar_at(vec2(pixel) + 0.5);
    vec2 at = vec2(KNEE_PX * polar.x, columns_at(polar.y, START_PX, TURN_PX, KNEE_PX));
    vec3 colour = look_up(cells, at, WHOLE_TURN == 1);
    imageStore(picture, pixel, vec4(clamp(colour, 0.0, 1.0), 1.0));
}
