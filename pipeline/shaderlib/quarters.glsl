// The low-pass of a fill: push-pull's means of 4x4 pixels, interpolated.
// Twin: lowpass() in shiftmap/base.py. Change both or neither.
//
// The includer declares the images `quarters` and `quarter_guide`. Include guided.glsl before.

#include "taps.glsl"

// The four means around a pixel; all pixels of 2x2 have the same.
struct Means {
    vec4 a, b, c, d;
    vec4 guides;
};

Means means_around(ivec2 pixel) {
    ivec2 first = (2 * pixel - 3) >> 3, last = imageSize(quarters) - 1;
    Taps taps = taps_of(clamp(first, ivec2(0), last), clamp(first + 1, ivec2(0), last));
    return Means(imageLoad(quarters, taps.a), imageLoad(quarters, taps.b),
                 imageLoad(quarters, taps.c), imageLoad(quarters, taps.d),
                 GUIDES_AT(quarter_guide, taps));
}

// `eighths` of the way between means.
vec3 low_of(Means means, ivec2 eighths, float guide) {
    vec2 part = vec2(eighths & 7), rest = 8.0 - part;
    vec4 bilinear = vec4(rest.x * rest.y, part.x * rest.y, rest.x * part.y, part.x * part.y);
    vec4 share = guided_shares(bilinear, guide, means.guides).share;
    return mixed(share, means.a, means.b, means.c, means.d).rgb;
}

vec3 low_at(ivec2 pixel, float guide) {
    return low_of(means_around(pixel), 2 * pixel - 3, guide);
}

// In the middle of 2x2 pixels, of which this is the first.
vec3 half_low_at(ivec2 pixel, float guide) {
    return low_of(means_around(pixel), 2 * pixel - 2, guide);
}
