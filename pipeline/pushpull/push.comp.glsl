#version 430
// Push: complete one level with the next coarser one.
// Twins: push() in reference.py, expand() there if SQUARED. Change both or neither.

#constant TILE     // work-group edge, pixels
#constant SQUARED  // 1: both are blended by the ratio of their squared weights; 0: by a confidence

layout(local_size_x = TILE, local_size_y = TILE) in;

// rgb: encoded colour. a: weight, as pull.comp.glsl has it.
uniform sampler2D fine;                     // W x H
uniform sampler2D coarse;                   // ceil(W / 2) x ceil(H / 2), complete
layout(rgba32f) uniform writeonly image2D filled;  // W x H; may be `fine` itself

uniform bool keeps_weight;  // the last step: weights still tell what was known

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(filled)))) return;

    // Bilinear by hand: texture units interpolate with as few as 8 bits.
    ivec2 last = textureSize(coarse, 0) - 1;
    ivec2 near = pixel >> 1;
    ivec2 far = clamp(near + 2 * (pixel & 1) - 1, ivec2(0), last);
    vec4 below = 0.5625 * texelFetch(coarse, near, 0)
               + 0.1875 * (texelFetch(coarse, ivec2(far.x, near.y), 0)
                           + texelFetch(coarse, ivec2(near.x, far.y), 0))
               + 0.0625 * texelFetch(coarse, far, 0);

    vec4 texel = texelFetch(fine, pixel, 0);
    float weight = texel.a;
    float ours = SQUARED == 1 ? weight * weight : weight;
    float theirs = SQUARED == 1 ? below.a * below.a : 1.0;
    // Not mix(): where a pixel holds its own, it must stay bit for bit.
    if (ours < theirs) {
        float share = ours / theirs, rest = 1.0 - share;
        texel = vec4(share * texel.rgb + rest * below.rgb, (SQUARED == 1 ? share : 1.0) * weight + rest * below.a);
    }
    if (keeps_weight) texel.a = weight;
    imageStore(filled, pixel, texel);
}
