// The low-pass of a fill: push-pull's means of 4x4 pixels, interpolated.
// Twin: lowpass() in shiftmap/base.py. Change both or neither.
//
// The includer declares the images `quarters` and `quarter_guide`. Include guided.glsl before.

#include "taps.glsl"

vec3 low_at(ivec2 pixel, float guide) {
    ivec2 eighths = 2 * pixel - 3;  // of the distance of two means
    ivec2 first = eighths >> 3, last = imageSize(quarters) - 1;
    vec2 part = vec2(eighths & 7), rest = 8.0 - part;
    Taps taps = taps_of(clamp(first, ivec2(0), last), clamp(first + 1, ivec2(0), last));
    vec4 bilinear = vec4(rest.x * rest.y, part.x * rest.y, rest.x * part.y, part.x * part.y);
    vec4 share = guided_shares(bilinear, guide, GUIDES_AT(quarter_guide, taps)).share;
    return MIXED_AT(quarters, taps, share, 0).rgb;
}
