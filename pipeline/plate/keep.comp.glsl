#version 430
// Keep what this view claimed.
// Twin: reference.py. Change both or neither.

#constant ROW  // work-group size, pixels in a row

layout(local_size_x = ROW) in;

#include "plate.glsl"

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!is_hole(pixel)) return;
    ivec2 place = place_of(pixel);
    ivec2 texel = nearest(place);
    if (!is_within(texel, imageSize(plate_m))) return;
    uint number = texel_number(texel);
    if (claims[number] != number_of(pixel)) return;
    claims[number] = NOBODY;
    ivec2 centre = SUBPIXELS * (pixel + texel) - place;
    uint total = uint(holes_around(centre));
    uvec3 summed = uvec3(0u);
    for (int k = 0; k < 4; ++k) {
        ivec2 near = floored(centre) + corner_of(k);
        if (!is_hole(near)) continue;
        vec3 steps = roundEven(float(STEPS) * imageLoad(image, near).rgb);
        summed += uint(share_of(centre, corner_of(k))) * uvec3(steps);
    }
    uvec3 kept = (summed + total / 2u) / total;
    imageStore(plate, texel, uvec4(kept.x | (kept.y << 16), kept.z, 0u, 0u));
    imageStore(plate_m, texel, vec4(imageLoad(depth_m, pixel).x));
}
