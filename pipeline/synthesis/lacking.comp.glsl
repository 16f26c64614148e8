#version 430
// From one level's inpainted moments to the noise each pixel lacks: variances of bands high,
// along x, along y in Y', Cb, Cr (with CROSS, chroma's covariance with luma). Visits what push completed: every texel that a hole pixel's
// interpolation reaches has a coefficient that the hole spoils.
// Twin: noise_variances() and detail_gain() in reference.py. Change both or neither.

#constant GAIN               // 1: also say how much of the luma deviation the base lacks
#constant CROSS              // 1: second moments are products with luma, else squares
#constant PLANES             // vec4 per texel of moments
#constant SMALLEST_VARIANCE  // below it a band is empty and no slope can be measured

#include "pixels.glsl"
#include "bands.glsl"

layout(rgba32f, binding = 0) uniform readonly image2D level;  // rgb: filled colour
layout(std430, binding = 4) readonly buffer Moments { vec4 moments[]; };
layout(std430, binding = 5) writeonly buffer Lacking { vec4 variances[]; };  // w: guide, gain, -
layout(std430, binding = 6) readonly buffer Guide { float guide[]; };

uniform int chain;
uniform int first_texel;  // of this level's variances

vec3 squared(vec3 v) { return v * v; }

vec3 lacking(vec3 mean, vec3 second, vec3 present) {
    vec3 variance = second - mean * (CROSS == 1 ? mean.xxx : mean);
    vec3 missing = max(vec3(0.0), variance - present);
#if CROSS
    missing = missing.x * (variance.x > SMALLEST_VARIANCE ? variance / variance.x : vec3(0.0));
#endif
    return missing;
}

void work(ivec2 pixel) {
    int place = pixel.y * work_size.x + pixel.x;
    int from = (chain * work_size.x * work_size.y + place) * PLANES;
    vec4 plane_0 = moments[from];
    ivec2 size = imageSize(level);
    FETCH_WINDOW(level, pixel, size)
    bvec2 whole = lessThan(inner_ + 1, size);
    BANDS_OF_CHILDREN(whole)

    vec4 plane_1 = moments[from + 1], plane_2 = moments[from + 2];
    vec4 plane_3 = moments[from + 3], plane_4 = moments[from + 4];

#define PRESENT(name, mean)                                                        \
    (0.25 * (squared(a.name - (mean)) + squared(b.name - (mean)) + squared(c.name - (mean)) \
             + squared(d.name - (mean))))
    vec3 high = lacking(plane_0.rgb, vec3(plane_1.w, plane_2.w, plane_3.w),
                        PRESENT(high, plane_0.rgb));
    vec3 along_x = lacking(plane_1.rgb, plane_3.rgb, PRESENT(along_x, plane_1.rgb));
    vec3 along_y = lacking(plane_2.rgb, plane_4.rgb, PRESENT(along_y, plane_2.rgb));
    float gain = 0.0;
#if GAIN
    float luma = high.x + along_x.x + along_y.x;
    vec3 means = vec3(plane_0.x, plane_1.x, plane_2.x);
    float wanted = dot(vec3(plane_1.w, plane_3.x, plane_4.x) - means * means, vec3(1.0));
    gain = wanted > SMALLEST_VARIANCE ? sqrt(luma / wanted) : 0.0;
#endif
    int to = (first_texel + place) * 3;
    variances[to] = vec4(high, guide[place]);
    variances[to + 1] = vec4(along_x, gain);
    variances[to + 2] = vec4(along_y, 0.0);
}
