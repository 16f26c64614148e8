#version 430
// Push: complete a level with the next coarser one, in place: mix(coarse, fine, validity^gamma).
// Twin: push() in reference.py. Change both or neither.

#constant TILE     // work-group edge, pixels
#constant COLUMNS  // planes side by side,
#constant ROWS     // and below each other

layout(local_size_x = TILE, local_size_y = TILE) in;

layout(rgba32f) uniform image2D fine;
layout(rg32f) uniform readonly image2D fine_state;  // validity, guide
layout(rgba32f) uniform readonly image2D coarse;    // complete

uniform ivec2 coarse_size;  // of one plane
uniform float gamma;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    ivec2 size = imageSize(fine_state);
    if (any(greaterThanEqual(pixel, size))) return;
    float validity = imageLoad(fine_state, pixel).x;
    if (validity >= 1.0) return;
    float share = validity > 0.0 ? pow(validity, gamma) : 0.0;  // 0 stays 0 at every gamma
    ivec2 near = pixel >> 1;
    ivec2 far = clamp(near + 2 * (pixel & 1) - 1, ivec2(0), coarse_size - 1);
    for (int row = 0; row < ROWS; ++row)
        for (int column = 0; column < COLUMNS; ++column) {
            ivec2 from = ivec2(column, row) * coarse_size;
            vec4 below = 0.5625 * imageLoad(coarse, from + near)
                       + 0.1875 * (imageLoad(coarse, from + ivec2(far.x, near.y))
                                   + imageLoad(coarse, from + ivec2(near.x, far.y)))
                       + 0.0625 * imageLoad(coarse, from + far);
            ivec2 at = ivec2(column, row) * size + pixel;
            imageStore(fine, at, share * imageLoad(fine, at) + (1.0 - share) * below);
        }
}
