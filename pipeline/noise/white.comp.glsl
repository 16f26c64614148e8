#version 430
// White noise of one channel, which may go on around what it is of.
// Twin: white_steps() in tile.py. Change both or neither.

#constant TILE  // work-group edge, pixels

#include "white.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform ivec2 first;   // place of the first pixel
uniform ivec2 period;  // pixels after which noise goes on as it began
layout(r32i) uniform writeonly iimage2D white;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(white)))) return;
    imageStore(white, pixel, ivec4(white_at((pixel + first) % period).x));
}
