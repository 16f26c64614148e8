// The three bands (high, along x, along y) of pixels from their 3x3 neighbourhoods.
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

// Of three channels. Differences, so that a constant answers exactly 0. Rows from the top, left to
// right.
Bands linear_bands(vec3 nw, vec3 n, vec3 ne, vec3 w, vec3 c, vec3 e, vec3 sw, vec3 s, vec3 se) {
    return Bands(HIGH_EDGE * ((n - c) + (w - c) + (e - c) + (s - c))
                     + HIGH_CORNER * ((nw - c) + (ne - c) + (sw - c) + (se - c)),
                 ORIENTED_EDGE * (e - w) + ORIENTED_CORNER * ((ne - nw) + (se - sw)),
                 ORIENTED_EDGE * (s - n) + ORIENTED_CORNER * ((sw - nw) + (se - ne)));
}

// In Y'CbCr, of R'G'B'.
Bands bands_of(vec3 nw, vec3 n, vec3 ne, vec3 w, vec3 c, vec3 e, vec3 sw, vec3 s, vec3 se) {
    Bands rgb = linear_bands(nw, n, ne, w, c, e, sw, s, se);
    return Bands(YCBCR_FROM_RGB * rgb.high, YCBCR_FROM_RGB * rgb.along_x,
                 YCBCR_FROM_RGB * rgb.along_y);
}

// Four texels of a level in a row.
struct Four {
    vec4 a, b, c, d;
};

// The 4x4 texels of a level around 2x2 children, borders repeated.
struct Window {
    Four r0, r1, r2, r3;
};

// Bands of 2x2 children, row by row.
struct ChildBands {
    Bands a, b, c, d;
};

#define BANDS_AT(above, here, below, left, centre, right)                        \
    bands_of(above.left.rgb, above.centre.rgb, above.right.rgb, here.left.rgb,   \
             here.centre.rgb, here.right.rgb, below.left.rgb, below.centre.rgb, below.right.rgb)

// The first stands for one that an odd border has not (`whole` false).
ChildBands child_bands(Window w, bvec2 whole) {
    ChildBands bands;
    bands.a = BANDS_AT(w.r0, w.r1, w.r2, a, b, c);
    bands.b = BANDS_AT(w.r0, w.r1, w.r2, b, c, d);
    bands.c = BANDS_AT(w.r1, w.r2, w.r3, a, b, c);
    bands.d = BANDS_AT(w.r1, w.r2, w.r3, b, c, d);
    if (!whole.x) { bands.b = bands.a; bands.d = bands.c; }
    if (!whole.y) { bands.c = bands.a; bands.d = bands.b; }
    return bands;
}
