#version 430
// Pull: average the known pixels of one level into the next coarser one.
// Twin: pull() in reference.py. Change both or neither.

#constant TILE  // work-group edge, pixels

layout(local_size_x = TILE, local_size_y = TILE) in;

// rgb: encoded colour. a: confidence in [0, 1]; 0 means unknown.
uniform sampler2D fine;                     // W x H
layout(rgba32f) uniform writeonly image2D coarse;  // ceil(W / 2) x ceil(H / 2)

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(coarse)))) return;

    // The last row or column of an odd level has no second child.
    bvec2 whole = lessThan(2 * pixel + 1, textureSize(fine, 0));
    vec4 a = texelFetch(fine, 2 * pixel, 0);
    vec4 b = whole.x ? texelFetch(fine, 2 * pixel + ivec2(1, 0), 0) : vec4(0.0);
    vec4 c = whole.y ? texelFetch(fine, 2 * pixel + ivec2(0, 1), 0) : vec4(0.0);
    vec4 d = all(whole) ? texelFetch(fine, 2 * pixel + 1, 0) : vec4(0.0);

    vec3 colour = a.a * a.rgb + b.a * b.rgb + c.a * c.rgb + d.a * d.rgb;
    float weight = a.a + b.a + c.a + d.a;
    imageStore(coarse, pixel, weight > 0.0 ? vec4(colour / weight, min(weight, 1.0)) : vec4(0.0));
}
