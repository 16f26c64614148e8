#version 430
// Colours that a view knows, and those that the plate keeps for its holes; all else nothing.
// Twin: reference.py. Change both or neither.

#constant ROW  // work-group size, pixels in a row

layout(local_size_x = ROW) in;

#include "plate.glsl"

layout(rgba32f) uniform writeonly image2D known;  // a: weight; 0: to be filled

uniform float recalled_weight;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!is_within(pixel, imageSize(image))) return;
    vec4 texel = vec4(imageLoad(image, pixel).rgb, 1.0);
    if (is_hole(pixel)) {
        vec3 colour;
        bool kept = recalled(place_of(pixel), imageLoad(depth_m, pixel).x, colour);
        texel = kept ? vec4(colour, recalled_weight) : vec4(0.0);
    }
    imageStore(known, pixel, texel);
}
