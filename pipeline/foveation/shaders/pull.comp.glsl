#version 430
// Pull: low-pass and halve the picture, make its bands' moments, and halve all older moments.
// Twin: chain_of() in chain.py, moment_chain() and colour_shape() in pooled_moments.py. Change both or neither.

#constant TILE    // work-group edge, texels
#constant WRAPS   // 1: the picture goes on at its other side
#constant OWN     // 1: this resolution is a pyramid level: make its bands' moments; 0: none
#constant OLDER   // pyramid levels whose moments there are already
#constant CHROMA  // 1: Cb and Cr's products with luma too; 0: none
#constant POWERS  // 1: make the powers of colours here; 2: halve them; 0: neither

#include "lowpass.glsl"
#include "ycbcr.glsl"
#include "bands.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform sampler2D fine;                     // W x H: R'G'B'
layout(rgba32f) uniform writeonly image2D coarse;  // ceil(W / 2) x ceil(H / 2)
// Two layers a level. Even: squares of luma's bands, a: luma times Cb, summed over bands. Odd:
// means of luma's bands, a: luma times Cr.
uniform sampler2DArray fine_moments;
layout(rgba32f) uniform writeonly image2DArray coarse_moments;

// Three layers: red, green and blue less 1/2, a: Cb squared; their squares, a: Cr squared; their cubes,
// a: the sum of their fourth powers.
uniform sampler2DArray fine_powers;
layout(rgba32f) uniform writeonly image2DArray coarse_powers;

struct Row { vec4 a, b, c, d; };

Row row_at(ivec4 x, int y) {
    return Row(texelFetch(fine, ivec2(x.x, y), 0), texelFetch(fine, ivec2(x.y, y), 0),
               texelFetch(fine, ivec2(x.z, y), 0), texelFetch(fine, ivec2(x.w, y), 0));
}

vec4 outer(Row r) { return low_outer(r.a, r.b, r.c, r.d); }
vec4 inner(Row r) { return low_inner(r.a, r.b, r.c, r.d); }

// Halve a layer of an array.
#define LAYER_ROW(array, row, layer)                                                                \
    Row(texelFetch(array, ivec3(x.x, row, layer), 0), texelFetch(array, ivec3(x.y, row, layer), 0), \
        texelFetch(array, ivec3(x.z, row, layer), 0), texelFetch(array, ivec3(x.w, row, layer), 0))
#define LAYER(array, layer)                                                        \
    (outer(LAYER_ROW(array, y.x, layer)) + inner(LAYER_ROW(array, y.y, layer))     \
     + inner(LAYER_ROW(array, y.z, layer)) + outer(LAYER_ROW(array, y.w, layer)))

mat3x4 powers_of(vec4 texel) {
    vec3 colour = texel.rgb - 0.5, square = colour * colour, ycc = YCBCR_FROM_RGB * colour;
    return mat3x4(vec4(colour, ycc.y * ycc.y), vec4(square, ycc.z * ycc.z),
                  vec4(square * colour, dot(square, square)));
}

const vec3 LUMA = vec3(YCBCR_FROM_RGB[0].x, YCBCR_FROM_RGB[1].x, YCBCR_FROM_RGB[2].x);

#define BANDS(of, above, here, below, left, centre, right)                                        \
    linear_bands(of(above.left), of(above.centre), of(above.right), of(here.left), of(here.centre), \
                 of(here.right), of(below.left), of(below.centre), of(below.right))

// Add a coefficient's moments. Chroma's bands are sums of those of red, green and blue, and so are
// its products with luma's.
#define COLOUR(texel) (CHROMA == 1 ? texel.rgb : vec3(dot(LUMA, texel.rgb)))
#define GREY(band) (CHROMA == 1 ? dot(LUMA, band) : band.x)
#define ADD(weight, above, here, below, left, centre, right)                                         \
    {                                                                                                \
        Bands rgb = BANDS(COLOUR, above, here, below, left, centre, right);                          \
        vec3 luma = vec3(GREY(rgb.high), GREY(rgb.along_x), GREY(rgb.along_y));                      \
        vec3 weighed = (weight) * luma;                                                              \
        square += weighed * luma;                                                                    \
        mean += weighed;                                                                             \
        if (CHROMA == 1)                                                                             \
            product += weighed.x * rgb.high + weighed.y * rgb.along_x + weighed.z * rgb.along_y;     \
    }

void main() {
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(texel, imageSize(coarse)))) return;
    ivec2 size = textureSize(fine, 0);
    ivec4 x = neighbours(2 * texel.x - 1, size.x, WRAPS == 1);
    ivec4 y = neighbours(2 * texel.y - 1, size.y, false);
    Row r0 = row_at(x, y.x), r1 = row_at(x, y.y), r2 = row_at(x, y.z), r3 = row_at(x, y.w);
    imageStore(coarse, texel, outer(r0) + inner(r1) + inner(r2) + outer(r3));
    // The first of two texels stands for one that an odd border has not.
    vec2 whole = vec2(lessThan(2 * texel + 1, size)), first = 0.5 * (2.0 - whole), next = 0.5 * whole;
    if (OWN == 1) {
        vec3 square = vec3(0.0), mean = vec3(0.0), product = vec3(0.0);
        ADD(first.x * first.y, r0, r1, r2, a, b, c)
        ADD(next.x * first.y, r0, r1, r2, b, c, d)
        ADD(first.x * next.y, r1, r2, r3, a, b, c)
        ADD(next.x * next.y, r1, r2, r3, b, c, d)
        vec3 cross_sum = YCBCR_FROM_RGB * product;
        imageStore(coarse_moments, ivec3(texel, 2 * OLDER), vec4(square, cross_sum.y));
        imageStore(coarse_moments, ivec3(texel, 2 * OLDER + 1), vec4(mean, cross_sum.z));
    }
    for (int layer = 0; layer < 2 * OLDER; ++layer)
        imageStore(coarse_moments, ivec3(texel, layer), LAYER(fine_moments, layer));
    if (POWERS == 1) {
        mat3x4 powers = first.x * first.y * powers_of(r1.b) + next.x * first.y * powers_of(r1.c)
                      + first.x * next.y * powers_of(r2.b) + next.x * next.y * powers_of(r2.c);
        for (int layer = 0; layer < 3; ++layer) imageStore(coarse_powers, ivec3(texel, layer), powers[layer]);
    }
    if (POWERS == 2)
        for (int layer = 0; layer < 3; ++layer)
            imageStore(coarse_powers, ivec3(texel, layer), LAYER(fine_powers, layer));
}
