#version 430
// From one level's moments to the noise each pixel lacks: variances of bands high, along x, along
// y in Y', Cb, Cr (with CROSS, chroma's covariance with luma). Makes the moments of 2x2 once more
// and completes them by a push. Visits what moments_first.comp.glsl listed: every texel that a
// hole pixel's interpolation reaches has a coefficient that the hole spoils.
// Twin: lacking.py, and push() in inpaint/reference.py. Change both or neither.

#constant GAMMA              // how much of itself an incomplete texel keeps, see kept()
#constant GAIN               // 1: also say how much of the luma deviation the base lacks
#constant KNOWN_ENOUGH       // share of known background that settles a band
#constant SMALLEST_VARIANCE  // below it a band is empty and no slope can be measured

#include "pixels.glsl"
#include "guided.glsl"
#include "taps.glsl"
#include "planes.glsl"
#include "moments.glsl"
#include "window.glsl"

layout(rgba32f) uniform readonly image2D coarse;  // moments of 4x4, complete
layout(rgba32f) uniform writeonly image2D variances;  // w: guide, gain
layout(r32f) uniform readonly image2D half_guide;     // of 2x2
layout(r32f) uniform readonly image2D quarter_guide;  // of 4x4
layout(rgba32f) uniform readonly image2D base;        // of 2x2; a: confidence

uniform ivec2 coarse_size;
uniform ivec2 corner;  // of this level's variances

vec3 squared(vec3 v) { return v * v; }

float known_at(ivec2 place, float deepest) {
    place = clamp(place, ivec2(0), work_size - 1);
    return deepest - imageLoad(half_guide, place).r <= depth_threshold ? max(0.0, imageLoad(base, place).a) : 0.0;
}

// Share of known background in a 3x3 binomial window.
float known_background(ivec2 place, float deepest) {
    float corners = known_at(place - 1, deepest) + known_at(place + ivec2(1, -1), deepest)
                  + known_at(place + ivec2(-1, 1), deepest) + known_at(place + 1, deepest);
    float edges = known_at(place - ivec2(0, 1), deepest) + known_at(place - ivec2(1, 0), deepest)
                + known_at(place + ivec2(1, 0), deepest) + known_at(place + ivec2(0, 1), deepest);
    return 0.0625 * (corners + 2.0 * edges + 4.0 * known_at(place, deepest));
}

// `held`: share of the wanted variance that the base is taken to hold; negative: as measured.
vec3 lacking(vec3 mean, vec3 second, vec3 measured, float held) {
    vec3 variance = second - mean * (CROSS == 1 ? mean.xxx : mean);
    vec3 present = held < 0.0 ? measured : held * variance;
    vec3 missing = max(vec3(0.0), variance - present);
#if CROSS
    missing = missing.x * (variance.x > SMALLEST_VARIANCE ? variance / variance.x : vec3(0.0));
#endif
    return missing;
}

Four row(int y, int x, ivec2 last) {
    y = clamp(y, 0, last.y);
    return Four(imageLoad(level, ivec2(max(x - 1, 0), y)), imageLoad(level, ivec2(x, y)),
                imageLoad(level, ivec2(min(x + 1, last.x), y)),
                imageLoad(level, ivec2(min(x + 2, last.x), y)));
}

vec4 guide_row(int y, int x, ivec2 last) {
    y = clamp(y, 0, last.y);
    return vec4(guide_at(ivec2(max(x - 1, 0), y)), guide_at(ivec2(x, y)),
                guide_at(ivec2(min(x + 1, last.x), y)), guide_at(ivec2(min(x + 2, last.x), y)));
}

void work(ivec2 pixel, int chain) {
    ivec2 size = imageSize(level), last = size - 1, near = 2 * pixel;
    Window window = Window(row(near.y - 1, near.x, last), row(near.y, near.x, last),
                           row(near.y + 1, near.x, last), row(near.y + 2, near.x, last));
    WindowGuide guides =
        WindowGuide(guide_row(near.y - 1, near.x, last), guide_row(near.y, near.x, last),
                    guide_row(near.y + 1, near.x, last), guide_row(near.y + 2, near.x, last));
    float deepest = imageLoad(half_guide, pixel).r;
    Measured m = measure(window, guides, near, size, deepest);

    Taps taps = parents_of(pixel, coarse_size);
    Shares below = push_shares(deepest, GUIDES_AT(quarter_guide, taps));
    taps = texels_at(taps, chain, coarse_size.y);
    float keep = kept(m.moments.plane_0.w, GAMMA, below.similar);
#define COMPLETED(plane, offset) \
    ((1.0 - keep) * MIXED_AT(coarse, taps, below.share, offset) + keep * m.moments.plane)
    vec4 plane_0 = COMPLETED(plane_0, ivec2(0, 0));  // its w is no moment
    vec4 plane_1 = COMPLETED(plane_1, ivec2(1, 0)), plane_2 = COMPLETED(plane_2, ivec2(2, 0));
    vec4 plane_3 = COMPLETED(plane_3, ivec2(3, 0)), plane_4 = COMPLETED(plane_4, ivec2(4, 0));

    float known = known_background(pixel, deepest);
    float held = m.outlined ? min(1.0, known / KNOWN_ENOUGH) : -1.0;
#define MEASURED(name, mean)                                                   \
    (0.25 * (squared(m.bands.a.name - (mean)) + squared(m.bands.b.name - (mean)) \
             + squared(m.bands.c.name - (mean)) + squared(m.bands.d.name - (mean))))
    vec3 high = lacking(plane_0.rgb, vec3(plane_1.w, plane_2.w, plane_3.w),
                        MEASURED(high, plane_0.rgb), held);
    vec3 along_x = lacking(plane_1.rgb, plane_3.rgb, MEASURED(along_x, plane_1.rgb), held);
    vec3 along_y = lacking(plane_2.rgb, plane_4.rgb, MEASURED(along_y, plane_2.rgb), held);
    float gain = 0.0;
#if GAIN
    float luma = high.x + along_x.x + along_y.x;
    vec3 means = vec3(plane_0.x, plane_1.x, plane_2.x);
    vec3 wanted = vec3(plane_1.w, plane_3.x, plane_4.x) - means * means;
    float total = dot(wanted, vec3(1.0));
    gain = total > SMALLEST_VARIANCE ? sqrt(luma / total) : 0.0;
#endif
    ivec2 to = ivec2(3 * pixel.x, pixel.y) + corner;
    imageStore(variances, to, vec4(high, deepest));
    imageStore(variances, to + ivec2(1, 0), vec4(along_x, gain));
    imageStore(variances, to + ivec2(2, 0), vec4(along_y, 0.0));
}
