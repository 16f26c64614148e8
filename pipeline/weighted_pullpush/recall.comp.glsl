#version 430
// What is known weighs 1; what a hole's place showed last, `recirculated`; all else nothing.
// Twin: recirculation.py. Change both or neither.

#constant ROW  // work-group size, pixels in a row

layout(local_size_x = ROW) in;

#include "plate.glsl"

layout(rgba32f) uniform writeonly image2D weighted;  // rgb, weight

uniform float recirculated;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!is_within(pixel, imageSize(image))) return;
    vec4 texel = vec4(imageLoad(image, pixel).rgb, 1.0);
    if (is_hole(pixel)) {
        vec3 colour;
        bool shown = recalled(place_of(pixel), imageLoad(depth_m, pixel).x, colour);
        texel = shown ? vec4(colour, recirculated) : vec4(0.0);
    }
    imageStore(weighted, pixel, texel);
}
