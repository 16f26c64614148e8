#version 430
// Reduce: average 2x2 pixels into one, each counting with its squared weight.
// Twin: reduce() in reference.py. Change both or neither.

#constant TILE  // work-group edge, pixels

layout(local_size_x = TILE, local_size_y = TILE) in;

// rgb: encoded colour. a: weight, 1 / quality^2, at least 0; 0 means unknown.
uniform sampler2D fine;                     // W x H
layout(rgba32f) uniform writeonly image2D coarse;  // ceil(W / 2) x ceil(H / 2)

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(coarse)))) return;

    // The last row or column of an odd level repeats.
    ivec2 near = 2 * pixel;
    ivec2 far = min(near + 1, textureSize(fine, 0) - 1);
    vec4 a = texelFetch(fine, near, 0);
    vec4 b = texelFetch(fine, ivec2(far.x, near.y), 0);
    vec4 c = texelFetch(fine, ivec2(near.x, far.y), 0);
    vec4 d = texelFetch(fine, far, 0);

    vec4 weight = vec4(a.a, b.a, c.a, d.a);
    vec4 square = weight * weight;
    float total = square.x + square.y + square.z + square.w;
    vec3 colour = square.x * a.rgb + square.y * b.rgb + square.z * c.rgb + square.w * d.rgb;
    float mean = 0.25 * (weight.x + weight.y + weight.z + weight.w);
    imageStore(coarse, pixel, total > 0.0 ? vec4(colour / total, mean) : vec4(0.0));
}
