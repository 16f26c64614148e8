#version 430
// Expand: blend one level with the next coarser one by the ratio of squared weights.
// Twin: expand() in reference.py. Change both or neither.

#constant TILE  // work-group edge, pixels

layout(local_size_x = TILE, local_size_y = TILE) in;

// rgb: encoded colour. a: weight, 1 / quality^2, at least 0; 0 means unknown.
uniform sampler2D fine;                     // W x H
uniform sampler2D coarse;                   // ceil(W / 2) x ceil(H / 2), expanded
layout(rgba32f) uniform writeonly image2D filled;  // W x H; may be `fine` itself

uniform bool keeps_weight;  // the last step: weights still tell what was known

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(filled)))) return;

    // The note's one bilinear fetch, by hand: texture units interpolate with as few as 8 bits.
    ivec2 last = textureSize(coarse, 0) - 1;
    ivec2 near = pixel >> 1;
    ivec2 far = clamp(near + 2 * (pixel & 1) - 1, ivec2(0), last);
    vec4 below = 0.5625 * texelFetch(coarse, near, 0)
               + 0.1875 * (texelFetch(coarse, ivec2(far.x, near.y), 0)
                           + texelFetch(coarse, ivec2(near.x, far.y), 0))
               + 0.0625 * texelFetch(coarse, far, 0);

    vec4 texel = texelFetch(fine, pixel, 0);
    float weight = texel.a;
    float ours = texel.a * texel.a;
    float theirs = below.a * below.a;
    // Not mix(): where a pixel holds its own, it must stay bit for bit.
    if (ours < theirs) {
        float share = ours / theirs;
        texel = share * texel + (1.0 - share) * below;
    }
    if (keeps_weight) texel.a = weight;
    imageStore(filled, pixel, texel);
}
