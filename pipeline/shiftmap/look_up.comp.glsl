#version 430
// Take what the plate keeps into the holes, and see which texels this view is first to fill.
// Twin: plate.py. Change both or neither.

#constant ROW          // work-group size, pixels in a row
#constant READ_SHARE   // a place counts as kept if more of its bilinear share is
#constant WRITE_SHARE  // a texel is written if more of this share is hole pixels

layout(local_size_x = ROW) in;

#include "plate.glsl"

uniform float same_surface;  // of the greater depth, what the smaller one has at least

void look_up(ivec2 pixel, ivec2 place) {
    float own = imageLoad(depth_m, pixel).x;
    int total = 0;
    uvec3 summed = uvec3(0u);
    for (int k = 0; k < 4; ++k) {
        ivec2 texel = floored(place) + corner_of(k);
        if (!is_within(texel, imageSize(plate_m))) continue;
        float there = imageLoad(plate_m, texel).x;
        if (there == 0.0 || min(own, there) < same_surface * max(own, there)) continue;
        uvec2 kept = imageLoad(plate, texel).xy;
        int share = share_of(place, corner_of(k));
        total += share;
        summed += uint(share) * uvec3(kept.x & 0xFFFFu, kept.x >> 16, kept.y);
    }
    if (total <= READ_SHARE) return;
    uvec3 steps = (summed + uint(total / 2)) / uint(total);
    imageStore(image, pixel, vec4(vec3(steps) / float(STEPS), 0.0));
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!is_hole(pixel)) return;
    ivec2 place = place_of(pixel);
    look_up(pixel, place);
    ivec2 texel = nearest(place);
    if (!is_within(texel, imageSize(plate_m)) || imageLoad(plate_m, texel).x != 0.0) return;
    if (holes_around(SUBPIXELS * (pixel + texel) - place) > WRITE_SHARE)
        atomicMin(claims[texel_number(texel)], number_of(pixel));
}
