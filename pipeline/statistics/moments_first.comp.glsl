#version 430
// First two pulls of one level's band moments: coefficients are made, checked and averaged here,
// 4x4 into one. Neither they nor the moments of 2x2 are stored: lacking.comp.glsl makes those it
// needs once more, which are few.
// Twin: band_statistics() in reference.py. Change both or neither.

#include "tiles.glsl"
#include "guided.glsl"
#include "taps.glsl"
#include "planes.glsl"
#include "window.glsl"
#include "moments.glsl"

layout(rgba32f) uniform writeonly image2D moments;
layout(r32f) uniform readonly image2D half_guide;     // of 2x2
layout(r32f) uniform readonly image2D quarter_guide;  // of 4x4

layout(std140) uniform Step {
    uvec2 halves_list;      // index and first entry: 2x2 that push has to complete
    uvec2 incomplete_list;  // the same for 4x4
};

// Six texels of a level in a row, and their guide.
struct Six {
    vec4 a, b, c, d, e, f;
    vec4 guide_left;   // a to d
    vec4 guide_right;  // c to f
};

Six row(int y, int x) {
    ivec2 last = imageSize(level) - 1;
    y = clamp(y, 0, last.y);
    ivec2 a = ivec2(clamp(x - 1, 0, last.x), y), b = ivec2(min(x, last.x), y);
    ivec2 c = ivec2(min(x + 1, last.x), y), d = ivec2(min(x + 2, last.x), y);
    ivec2 e = ivec2(min(x + 3, last.x), y), f = ivec2(min(x + 4, last.x), y);
    float guide_c = guide_at(c), guide_d = guide_at(d);
    return Six(imageLoad(level, a), imageLoad(level, b), imageLoad(level, c), imageLoad(level, d),
               imageLoad(level, e), imageLoad(level, f),
               vec4(guide_at(a), guide_at(b), guide_c, guide_d),
               vec4(guide_c, guide_d, guide_at(e), guide_at(f)));
}

#define LEFT(row) Four(row.a, row.b, row.c, row.d)
#define RIGHT(row) Four(row.c, row.d, row.e, row.f)

#define MOMENTS(SIDE, side, above, here, below, last, first, deepest)                \
    measure(Window(SIDE(above), SIDE(here), SIDE(below), SIDE(last)),                \
            WindowGuide(above.side, here.side, below.side, last.side), first, level_size, \
            deepest).moments

void work(ivec2 pixel, int chain) {
    ivec2 corner = 4 * pixel;
    Six r0 = row(corner.y - 1, corner.x), r1 = row(corner.y, corner.x);
    Six r2 = row(corner.y + 1, corner.x), r3 = row(corner.y + 2, corner.x);
    Six r4 = row(corner.y + 3, corner.x), r5 = row(corner.y + 4, corner.x);
    ivec2 level_size = imageSize(level);
    Taps taps = children_of(pixel, (level_size + 1) >> 1);
    vec4 guides = GUIDES_AT(half_guide, taps);

    // Of the 2x2 texels that make up the pixel.
    Moments a = MOMENTS(LEFT, guide_left, r0, r1, r2, r3, corner, guides.x);
    Moments b = MOMENTS(RIGHT, guide_right, r0, r1, r2, r3, corner + ivec2(2, 0), guides.y);
    Moments c = MOMENTS(LEFT, guide_left, r2, r3, r4, r5, corner + ivec2(0, 2), guides.z);
    Moments d = MOMENTS(RIGHT, guide_right, r2, r3, r4, r5, corner + 2, guides.w);
    // An odd border repeats its last texel.
    bvec2 whole = notEqual(taps.d, taps.a);
    if (!whole.x) { b = a; d = c; }
    if (!whole.y) { c = a; d = b; }

    vec4 validity = vec4(a.magnitude.w, b.magnitude.w, c.magnitude.w, d.magnitude.w);
    bvec4 incomplete = lessThan(validity, vec4(1.0));
    append_some(halves_list.x, halves_list.y, 2 * pixel, chain,
                bits(incomplete.x, incomplete.y && whole.x, incomplete.z && whole.y,
                     incomplete.w && all(whole)));
    Pull p = pull_shares(validity, guides, imageLoad(quarter_guide, pixel).r);
    ivec2 to = texel_at(pixel, chain, work_size.y);
#define PULLED(plane) mixed(p.share, a.plane, b.plane, c.plane, d.plane)
    imageStore(moments, to, vec4(PULLED(magnitude).rgb, p.confidence));
    imageStore(moments, to + ivec2(1, 0), PULLED(itself));
    imageStore(moments, to + ivec2(2, 0), PULLED(blue));
    imageStore(moments, to + ivec2(3, 0), PULLED(red));
    if (p.confidence < 1.0) append(incomplete_list.x, incomplete_list.y, pixel, chain);
}
