#version 430
// Pull: average the known pixels of one level into the next coarser one, each by its weight.
// Twins: pull() in reference.py, reduce() there if SQUARED. Change both or neither.

#constant TILE     // work-group edge, pixels
#constant SQUARED  // 1: pixels count with the square of their weight, 1 / quality^2; a mean has their mean

layout(local_size_x = TILE, local_size_y = TILE) in;

// rgb: encoded colour. a: weight, at least 0, which plain push-pull takes for a confidence up to 1; 0
// means unknown.
uniform sampler2D fine;                     // W x H
layout(rgba32f) uniform writeonly image2D coarse;  // ceil(W / 2) x ceil(H / 2)

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(coarse)))) return;

    // The last row or column of an odd level has no second child, or repeats if SQUARED.
    ivec2 near = 2 * pixel, far = min(near + 1, textureSize(fine, 0) - 1);
    vec2 whole = SQUARED == 1 ? vec2(1.0) : vec2(far - near);
    vec4 a = texelFetch(fine, near, 0);
    vec4 b = texelFetch(fine, ivec2(far.x, near.y), 0);
    vec4 c = texelFetch(fine, ivec2(near.x, far.y), 0);
    vec4 d = texelFetch(fine, far, 0);

    vec4 weight = vec4(a.a, whole.x * b.a, whole.y * c.a, whole.x * whole.y * d.a);
    vec4 counts = SQUARED == 1 ? weight * weight : weight;
    float total = counts.x + counts.y + counts.z + counts.w;
    vec3 colour = counts.x * a.rgb + counts.y * b.rgb + counts.z * c.rgb + counts.w * d.rgb;
    float mean = 0.25 * (weight.x + weight.y + weight.z + weight.w);
    vec4 texel = vec4(colour / total, SQUARED == 1 ? mean : min(total, 1.0));
    imageStore(coarse, pixel, total > 0.0 ? texel : vec4(0.0));
}
