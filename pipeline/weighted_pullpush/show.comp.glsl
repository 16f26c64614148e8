#version 430
// Bring the fill into the holes, and see which pixels the plate takes it from.
// Twin: recirculation.py. Change both or neither.

#constant ROW  // work-group size, pixels in a row

layout(local_size_x = ROW) in;

#include "plate.glsl"

layout(rgba32f) uniform readonly image2D filled;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!is_hole(pixel)) return;
    imageStore(image, pixel, vec4(imageLoad(filled, pixel).rgb, 0.0));
    ivec2 place = place_of(pixel);
    if (is_within(nearest(place), imageSize(plate_m))) claim(pixel, place);
}
