#version 430
// Bring the fill into the holes, and see which texels this view is to write.
// Twin: reference.py. Change both or neither.

#constant ROW  // work-group size, pixels in a row

layout(local_size_x = ROW) in;

#include "plate.glsl"

layout(rgba32f) uniform readonly image2D known;  // complete

uniform bool overwrites;  // what is kept; otherwise only what is new is written

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!is_hole(pixel)) return;
    imageStore(image, pixel, vec4(imageLoad(known, pixel).rgb, 0.0));
    ivec2 place = place_of(pixel), texel = nearest(place);
    if (is_within(texel, imageSize(plate_m)) && (overwrites || imageLoad(plate_m, texel).x == 0.0))
        claim(pixel, place);
}
