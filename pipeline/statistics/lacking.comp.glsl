#version 430
// From one level's moments to the noise each pixel lacks: variances of bands high, along x, along
// y in Y', Cb, Cr (with CROSS, chroma's covariance with luma). Makes the moments of 2x2 once more
// and completes them by a push. Visits what moments_first.comp.glsl listed: every texel that a
// hole pixel's interpolation reaches has a coefficient that the hole spoils.
// Twin: moments.py, and push() in inpaint/reference.py. Change both or neither.

#constant GAMMA              // how much of itself an incomplete texel keeps, see kept()
#constant LAPLACE            // variance over the square of the mean magnitude
#constant KNOWN_ENOUGH       // share of known background that settles a band
#constant SMALLEST_VARIANCE  // below it a band is empty and no slope can be measured

#include "pixels.glsl"
#include "guided.glsl"
#include "taps.glsl"
#include "planes.glsl"
#include "window.glsl"
#include "moments.glsl"

layout(rgba32f) uniform readonly image2D coarse;  // moments of 4x4, complete
layout(rgba32f) uniform writeonly image2D variances;  // w of the first: guide
layout(r32f) uniform readonly image2D half_guide;     // of 2x2
layout(r32f) uniform readonly image2D quarter_guide;  // of 4x4
layout(rgba32f) uniform readonly image2D base;        // of 2x2; a: confidence

layout(std140) uniform Step {
    ivec2 coarse_size;
    ivec2 corner;  // of this level's variances
};

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

// Of three bands: variance that is wanted, less what the base holds. That is a share `held` of it, or
// if negative its energy as measured.
vec3 lacking(vec3 variance, vec3 measured, float held) {
    return max(vec3(0.0), variance - (held < 0.0 ? measured : held * variance));
}

// Slope of chroma on luma.
vec3 slope_of(vec3 product, vec3 square) {
    return mix(vec3(0.0), product / square, greaterThan(square, vec3(SMALLEST_VARIANCE)));
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
    float keep = kept(m.moments.magnitude.w, GAMMA, below.similar);
#define COMPLETED(name, plane) \
    ((1.0 - keep) * MIXED_AT(coarse, taps, below.share, ivec2(plane, 0)) + keep * m.moments.name)
    vec3 magnitude = COMPLETED(magnitude, 0).rgb;
    vec4 itself = COMPLETED(itself, 1), of_blue = COMPLETED(blue, 2), of_red = COMPLETED(red, 3);

    float known = known_background(pixel, deepest);
    float held = m.outlined ? min(1.0, known / KNOWN_ENOUGH) : -1.0;
#define MEASURED(channel, about)                                                         \
    (0.25 * (squared(channel(m.bands.a) - (about)) + squared(channel(m.bands.b) - (about)) \
             + squared(channel(m.bands.c) - (about)) + squared(channel(m.bands.d) - (about))))
    vec3 wanted = LAPLACE * max(vec3(0.0), squared(magnitude) - squared(itself.rgb));
    vec3 luma = lacking(wanted, MEASURED(luma_of, itself.rgb), held);
#if CROSS
    vec3 square = vec3(itself.w, of_blue.w, of_red.w);
    vec3 blue = luma * slope_of(of_blue.rgb, square), red = luma * slope_of(of_red.rgb, square);
#else
    vec3 blue = lacking(LAPLACE * squared(of_blue.rgb), MEASURED(blue_of, vec3(0.0)), held);
    vec3 red = lacking(LAPLACE * squared(of_red.rgb), MEASURED(red_of, vec3(0.0)), held);
#endif
    ivec2 to = ivec2(3 * pixel.x, pixel.y) + corner;
    imageStore(variances, to, vec4(luma.x, blue.x, red.x, deepest));
    imageStore(variances, to + ivec2(1, 0), vec4(luma.y, blue.y, red.y, 0.0));
    imageStore(variances, to + ivec2(2, 0), vec4(luma.z, blue.z, red.z, 0.0));
}
