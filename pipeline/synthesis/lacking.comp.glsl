#version 430
// From one level's inpainted moments to the noise each pixel lacks: variances of bands high,
// along x, along y in Y', Cb, Cr (with CROSS, chroma's covariance with luma). Visits what push
// completed: every texel that a hole pixel's interpolation reaches has a coefficient that the
// hole spoils.
// Twin: lacking.py. Change both or neither.

#constant GAIN               // 1: also say how much of the luma deviation the base lacks
#constant CROSS              // 1: second moments are products with luma, else squares
#constant PLANES             // vec4 per texel of moments
#constant KNOWN_ENOUGH       // share of known background that continues a band by itself
#constant SHARED_FROM_LEVEL  // from it on, noise is raised where it fills its kernels in part
#constant MOST_SHARED        // share of known background beyond which it is raised no more
#constant SMALLEST_VARIANCE  // below it a band is empty and no slope can be measured

#include "pixels.glsl"
#include "bands.glsl"

layout(rgba32f, binding = 0) uniform readonly image2D level;  // rgb: filled colour
layout(std430, binding = 4) readonly buffer Moments { vec4 moments[]; };
// w: guide, gain, -. Until then the third is 1 if one of the 2x2 coefficients lies across a jump
// of depth, else 0 (moments_first.comp.glsl).
layout(std430, binding = 5) buffer Lacking { vec4 variances[]; };
layout(std430, binding = 6) readonly buffer Guide { float guide[]; };
layout(std430, binding = 7) readonly buffer Base { vec4 base[]; };  // w: confidence

uniform int chain;  // the level
uniform int first_texel;  // of this level's variances
uniform float depth_threshold;

vec3 squared(vec3 v) { return v * v; }

float known_at(ivec2 place, float deepest) {
    place = clamp(place, ivec2(0), work_size - 1);
    int at = place.y * work_size.x + place.x;
    return deepest - guide[at] <= depth_threshold ? max(0.0, base[at].w) : 0.0;
}

// Share of known background in a 3x3 binomial window.
float known_background(ivec2 place, float deepest) {
    float corners = known_at(place - 1, deepest) + known_at(place + ivec2(1, -1), deepest)
                  + known_at(place + ivec2(-1, 1), deepest) + known_at(place + 1, deepest);
    float edges = known_at(place - ivec2(0, 1), deepest) + known_at(place - ivec2(1, 0), deepest)
                + known_at(place + ivec2(1, 0), deepest) + known_at(place + ivec2(0, 1), deepest);
    return 0.0625 * (corners + 2.0 * edges + 4.0 * known_at(place, deepest));
}

// What the base holds, and noise has to fill.
struct Held {
    float share;  // of the wanted variance that the base is taken to hold; negative: as measured
    float part;   // of a kernel that noise fills
};

vec3 lacking(vec3 mean, vec3 second, vec3 measured, Held held) {
    vec3 variance = second - mean * (CROSS == 1 ? mean.xxx : mean);
    vec3 present = held.share < 0.0 ? measured : held.share * variance;
    vec3 missing = max(vec3(0.0), variance - present) / held.part;
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

    int to = (first_texel + place) * 3;
    float deepest = guide[place];
    float known = known_background(pixel, deepest);
    Held held;
    held.share = variances[to + 2].w == 0.0 ? -1.0 : min(1.0, known / KNOWN_ENOUGH);
    held.part = chain < SHARED_FROM_LEVEL ? 1.0 : 1.0 - min(known, MOST_SHARED);

#define MEASURED(name, mean)                                                        \
    (0.25 * (squared(a.name - (mean)) + squared(b.name - (mean)) + squared(c.name - (mean)) \
             + squared(d.name - (mean))))
    vec3 high = lacking(plane_0.rgb, vec3(plane_1.w, plane_2.w, plane_3.w),
                        MEASURED(high, plane_0.rgb), held);
    vec3 along_x = lacking(plane_1.rgb, plane_3.rgb, MEASURED(along_x, plane_1.rgb), held);
    vec3 along_y = lacking(plane_2.rgb, plane_4.rgb, MEASURED(along_y, plane_2.rgb), held);
    float gain = 0.0;
#if GAIN
    float luma = high.x + along_x.x + along_y.x;
    vec3 means = vec3(plane_0.x, plane_1.x, plane_2.x);
    float wanted = dot(vec3(plane_1.w, plane_3.x, plane_4.x) - means * means, vec3(1.0));
    gain = wanted > SMALLEST_VARIANCE ? sqrt(luma / wanted) : 0.0;
#endif
    variances[to] = vec4(high, deepest);
    variances[to + 1] = vec4(along_x, gain);
    variances[to + 2] = vec4(along_y, 0.0);
}
