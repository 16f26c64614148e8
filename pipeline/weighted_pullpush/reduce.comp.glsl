#version 430
// Reduce: average 2x2 pixels into one, each counting with its squared weight.
// Twin: reduce() in reference.py. Change both or neither.

#constant TILE  // work-group edge, pixels

layout(local_size_x = TILE, local_size_y = TILE) in;

// rgb: encoded colour. a: weight, 1 / quality^2, at least 0; 0 means unknown.
layout(binding = 0) uniform sampler2D fine;                     // W x H
layout(rgba32f, binding = 0) uniform writeonly image2D coarse;  // ceil(W / 2) x ceil(H / 2)

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(coarse)))) return;

    // The last row or column of an odd level has no second child.
    bvec2 whole = lessThan(2 * pixel + 1, textureSize(fine, 0));
    vec4 a = texelFetch(fine, 2 * pixel, 0);
    vec4 b = whole.x ? texelFetch(fine, 2 * pixel + ivec2(1, 0), 0) : vec4(0.0);
    vec4 c = whole.y ? texelFetch(fine, 2 * pixel + ivec2(0, 1), 0) : vec4(0.0);
    vec4 d = all(whole) ? texelFetch(fine, 2 * pixel + 1, 0) : vec4(0.0);

    vec4 weight = vec4(a.a, b.a, c.a, d.a);
    weight *= weight;
    float total = weight.x + weight.y + weight.z + weight.w;
    vec4 sum = weight.x * a + weight.y * b + weight.z * c + weight.w * d;
    imageStore(coarse, pixel, total > 0.0 ? sum / total : vec4(0.0));
}
