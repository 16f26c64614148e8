// The three bands (high, along x, along y) of one pixel from its 3x3 neighbourhood.
// Twin: band() in features/reference.py and ycbcr_from_rgb() in colour.py.

#constant HIGH_EDGE        // taps of the 3x3 high kernel: beside the centre,
#constant HIGH_CORNER      // at the corners
#constant ORIENTED_EDGE    // taps of the 3x3 oriented kernel, right column: centre row,
#constant ORIENTED_CORNER  // other rows

#include "ycbcr.glsl"

struct Bands {
    vec3 high;     // Y', Cb, Cr
    vec3 along_x;
    vec3 along_y;
};

// Differences, so that a constant answers exactly 0. Rows from the top, left to right.
Bands bands_of(vec3 nw, vec3 n, vec3 ne, vec3 w, vec3 c, vec3 e, vec3 sw, vec3 s, vec3 se) {
    vec3 high = HIGH_EDGE * ((n - c) + (w - c) + (e - c) + (s - c))
              + HIGH_CORNER * ((nw - c) + (ne - c) + (sw - c) + (se - c));
    vec3 along_x = ORIENTED_EDGE * (e - w) + ORIENTED_CORNER * ((ne - nw) + (se - sw));
    vec3 along_y = ORIENTED_EDGE * (s - n) + ORIENTED_CORNER * ((sw - nw) + (se - ne));
    return Bands(YCBCR_FROM_RGB * high, YCBCR_FROM_RGB * along_x, YCBCR_FROM_RGB * along_y);
}

// Declares window_00 to window_33 (row, column): the 4x4 texels of `level` around the 2x2
// children of `pixel`, borders repeated.
#define FETCH_WINDOW(level, pixel, size)                                         \
    ivec2 inner_ = 2 * (pixel);                                                  \
    ivec2 x_ = ivec2(max(inner_.x - 1, 0), min(inner_.x + 2, (size).x - 1));     \
    ivec2 y_ = ivec2(max(inner_.y - 1, 0), min(inner_.y + 2, (size).y - 1));     \
    ivec2 next_ = min(inner_ + 1, (size) - 1);                                   \
    vec4 window_00 = imageLoad(level, ivec2(x_.x, y_.x));                    \
    vec4 window_01 = imageLoad(level, ivec2(inner_.x, y_.x));                \
    vec4 window_02 = imageLoad(level, ivec2(next_.x, y_.x));                 \
    vec4 window_03 = imageLoad(level, ivec2(x_.y, y_.x));                    \
    vec4 window_10 = imageLoad(level, ivec2(x_.x, inner_.y));                \
    vec4 window_11 = imageLoad(level, inner_);                               \
    vec4 window_12 = imageLoad(level, ivec2(next_.x, inner_.y));             \
    vec4 window_13 = imageLoad(level, ivec2(x_.y, inner_.y));                \
    vec4 window_20 = imageLoad(level, ivec2(x_.x, next_.y));                 \
    vec4 window_21 = imageLoad(level, ivec2(inner_.x, next_.y));             \
    vec4 window_22 = imageLoad(level, next_);                                \
    vec4 window_23 = imageLoad(level, ivec2(x_.y, next_.y));                 \
    vec4 window_30 = imageLoad(level, ivec2(x_.x, y_.y));                    \
    vec4 window_31 = imageLoad(level, ivec2(inner_.x, y_.y));                \
    vec4 window_32 = imageLoad(level, ivec2(next_.x, y_.y));                 \
    vec4 window_33 = imageLoad(level, ivec2(x_.y, y_.y));

#define BANDS_AT(r0, r1, r2, c0, c1, c2)                                                     \
    bands_of(window_##r0##c0.rgb, window_##r0##c1.rgb, window_##r0##c2.rgb,                  \
             window_##r1##c0.rgb, window_##r1##c1.rgb, window_##r1##c2.rgb,                  \
             window_##r2##c0.rgb, window_##r2##c1.rgb, window_##r2##c2.rgb)

// Declares a to d: the bands of the 2x2 children, row by row. The first stands for one that
// an odd border has not (`whole` false).
#define BANDS_OF_CHILDREN(whole)                                  \
    Bands a = BANDS_AT(0, 1, 2, 0, 1, 2);                         \
    Bands b = a, c = a, d = a;                                    \
    if (whole.x) b = BANDS_AT(0, 1, 2, 1, 2, 3);                  \
    if (whole.y) c = BANDS_AT(1, 2, 3, 0, 1, 2);                  \
    if (whole.x && whole.y) d = BANDS_AT(1, 2, 3, 1, 2, 3);       \
    else if (whole.x) d = b;                                      \
    else if (whole.y) d = c;
