#version 430
// Cap: what is seen around a pole of a panorama, cubic between its pixels.
// Twin: cap_picture() in panorama.py. Change both or neither.

#constant TILE  // work-group edge, pixels

#include "pools.glsl"
#include "panorama.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform sampler2D panorama;
layout(rgba32f) uniform writeonly image2D cap;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(cap)))) return;
    vec3 colour = seen_in(panorama, seen_at(vec2(pixel) + 0.5).ray);
    imageStore(cap, pixel, vec4(clamp(colour, 0.0, 1.0), 1.0));
}
