#version 430
// Take what the plate keeps into the holes, and see which texels this view is first to fill.
// Twin: plate.py. Change both or neither.

#constant ROW  // work-group size, pixels in a row

layout(local_size_x = ROW) in;

#include "plate.glsl"

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!is_hole(pixel)) return;
    ivec2 place = place_of(pixel);
    vec3 colour;
    if (recalled(place, imageLoad(depth_m, pixel).x, colour))
        imageStore(image, pixel, vec4(colour, 0.0));
    ivec2 texel = nearest(place);
    if (is_within(texel, imageSize(plate_m)) && imageLoad(plate_m, texel).x == 0.0)
        claim(pixel, place);
}
