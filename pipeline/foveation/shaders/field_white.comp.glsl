#version 430
// The white vectors of a displacement's field. Twin: field_noise() in displacement.py. Change both or
// neither.

#constant TILE             // work-group edge, texels
#constant WHITE_DEVIATION  // steps

#include "white.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

layout(rg32f) uniform writeonly image2D noise;

void main() {
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(texel, imageSize(noise)))) return;
    imageStore(noise, texel, vec4(vec2(white_at(texel).xy) / WHITE_DEVIATION, 0.0, 0.0));
}
