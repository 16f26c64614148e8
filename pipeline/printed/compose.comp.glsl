#version 430
// Write the fill into the holes, in place. Twin: printed_fill() in reference.py. Change both or
// neither.

#constant TILE  // work-group edge, pixels

layout(local_size_x = TILE, local_size_y = TILE) in;

#include "ycbcr.glsl"

layout(rgba32f) uniform image2D image;  // encoded R'G'B'; a: 1 known, 0 hole
layout(rgba32f) uniform readonly image2D ycbcr;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(image)))) return;
    if (imageLoad(image, pixel).a > 0.0) return;
    vec3 colour = RGB_FROM_YCBCR * imageLoad(ycbcr, pixel).rgb;
    imageStore(image, pixel, vec4(clamp(colour, 0.0, 1.0), 0.0));
}
