#version 430
// Put a level's bands on top of what is coarser: each passes its kernel again, mirrored.
// Twin: synthesise() and double() in features/reference.py. Change both or neither.

#constant TILE       // work-group edge, pixels
#constant LOW_MIXED  // taps of the 4x4 low-pass kernel: one offset outer,
#constant LOW_OUTER  // both outer

layout(local_size_x = TILE, local_size_y = TILE) in;

#include "bands.glsl"

layout(rgba32f) uniform readonly image2D coarse;  // Y'CbCr
layout(rgba32f) uniform readonly image2D planes;  // bands side by side
layout(rgba32f) uniform writeonly image2D image;

vec3 plane(ivec2 pixel, int index, ivec2 size) {
    return imageLoad(planes, clamp(pixel, ivec2(0), size - 1) + ivec2(index * size.x, 0)).rgb;
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    ivec2 size = imageSize(image);
    if (any(greaterThanEqual(pixel, size))) return;
    ivec2 near = pixel >> 1;
    ivec2 far = clamp(near + 2 * (pixel & 1) - 1, ivec2(0), imageSize(coarse) - 1);
    vec3 base = imageLoad(coarse, near).rgb;
    vec3 value = base
        + 4.0 * LOW_MIXED * ((imageLoad(coarse, ivec2(near.x, far.y)).rgb - base)
                             + (imageLoad(coarse, ivec2(far.x, near.y)).rgb - base))
        + 4.0 * LOW_OUTER * (imageLoad(coarse, far).rgb - base);
    ivec2 right = ivec2(1, 0), down = ivec2(0, 1);
    vec3 c = plane(pixel, 0, size);
    value += HIGH_EDGE * ((plane(pixel - down, 0, size) - c) + (plane(pixel - right, 0, size) - c)
                          + (plane(pixel + right, 0, size) - c) + (plane(pixel + down, 0, size) - c))
           + HIGH_CORNER * ((plane(pixel - right - down, 0, size) - c)
                            + (plane(pixel + right - down, 0, size) - c)
                            + (plane(pixel - right + down, 0, size) - c)
                            + (plane(pixel + right + down, 0, size) - c));
    value += ORIENTED_EDGE * (plane(pixel - right, 1, size) - plane(pixel + right, 1, size))
           + ORIENTED_CORNER * ((plane(pixel - right - down, 1, size)
                                 - plane(pixel + right - down, 1, size))
                                + (plane(pixel - right + down, 1, size)
                                   - plane(pixel + right + down, 1, size)));
    value += ORIENTED_EDGE * (plane(pixel - down, 2, size) - plane(pixel + down, 2, size))
           + ORIENTED_CORNER * ((plane(pixel - down - right, 2, size)
                                 - plane(pixel + down - right, 2, size))
                                + (plane(pixel - down + right, 2, size)
                                   - plane(pixel + down + right, 2, size)));
    imageStore(image, pixel, vec4(value, 1.0));
}
