// Band moments of one texel: coefficients of 2x2 children are made, checked and averaged.
// Include guided.glsl and window.glsl before.
// Twin: band_statistics() and outlined_levels() in statistics/reference.py. Change both or neither.

#constant CROSS             // 1: of chroma its product with luma, else its magnitude
#constant SKIP_DEPTH_EDGES  // 1: a kernel across a jump of depth measures nothing

#include "bands.glsl"

// The guide of a window, row by row.
struct WindowGuide {
    vec4 r0, r1, r2, r3;
};

// As a chain stores them: means of the bands high, along x, along y. The squares of luma are the w of
// the last three planes.
struct Moments {
    vec4 magnitude;  // of luma; w: confidence
    vec4 itself;
    vec4 blue, red;  // of Cb and Cr: see CROSS
};

struct Measured {
    Moments moments;
    ChildBands bands;
    bool outlined;  // whether one of the four coefficients lies across a jump of depth
};

// Smallest (x) and largest (y) of three neighbours in a row.
vec2 extent(float a, float b, float c) { return vec2(min(min(a, b), c), max(max(a, b), c)); }

float least(vec3 v) { return min(min(v.x, v.y), v.z); }

bool jumps(vec2 above, vec2 here, vec2 below, float centre) {
    vec2 all = vec2(min(min(above.x, here.x), below.x), max(max(above.y, here.y), below.y));
    return max(centre - all.x, all.y - centre) > depth_threshold;
}

// Of the four children: whether a 3x3 kernel there spans a jump of depth.
vec4 across_a_jump(WindowGuide g) {
    vec2 left_0 = extent(g.r0.x, g.r0.y, g.r0.z), right_0 = extent(g.r0.y, g.r0.z, g.r0.w);
    vec2 left_1 = extent(g.r1.x, g.r1.y, g.r1.z), right_1 = extent(g.r1.y, g.r1.z, g.r1.w);
    vec2 left_2 = extent(g.r2.x, g.r2.y, g.r2.z), right_2 = extent(g.r2.y, g.r2.z, g.r2.w);
    vec2 left_3 = extent(g.r3.x, g.r3.y, g.r3.z), right_3 = extent(g.r3.y, g.r3.z, g.r3.w);
    return vec4(jumps(left_0, left_1, left_2, g.r1.y), jumps(right_0, right_1, right_2, g.r1.z),
                jumps(left_1, left_2, left_3, g.r2.y), jumps(right_1, right_2, right_3, g.r2.z));
}

// One channel of all bands.
vec3 luma_of(Bands b) { return vec3(b.high.x, b.along_x.x, b.along_y.x); }
vec3 blue_of(Bands b) { return vec3(b.high.y, b.along_x.y, b.along_y.y); }
vec3 red_of(Bands b) { return vec3(b.high.z, b.along_x.z, b.along_y.z); }

Moments moments_of(Bands b) {
    vec3 luma = luma_of(b), square = luma * luma;
    vec3 blue = CROSS == 1 ? luma * blue_of(b) : abs(blue_of(b));
    vec3 red = CROSS == 1 ? luma * red_of(b) : abs(red_of(b));
    return Moments(vec4(abs(luma), 0.0), vec4(luma, square.x), vec4(blue, square.y),
                   vec4(red, square.z));
}

// `window`: rgb filled; a 1 clean, 0 reached by a hole, below that mixed from two depths.
// `first`: the first child, of a level of `size`. `deepest`: the guide of all four.
Measured measure(Window w, WindowGuide g, ivec2 first, ivec2 size, float deepest) {
    // Clean of holes, row by row for the left and the right children.
    vec4 left = vec4(least(vec3(w.r0.a.a, w.r0.b.a, w.r0.c.a)), least(vec3(w.r1.a.a, w.r1.b.a, w.r1.c.a)),
                     least(vec3(w.r2.a.a, w.r2.b.a, w.r2.c.a)), least(vec3(w.r3.a.a, w.r3.b.a, w.r3.c.a)));
    vec4 right = vec4(least(vec3(w.r0.b.a, w.r0.c.a, w.r0.d.a)), least(vec3(w.r1.b.a, w.r1.c.a, w.r1.d.a)),
                      least(vec3(w.r2.b.a, w.r2.c.a, w.r2.d.a)), least(vec3(w.r3.b.a, w.r3.c.a, w.r3.d.a)));
    vec4 valid = step(0.5, vec4(least(left.xyz), least(right.xyz), least(left.yzw), least(right.yzw)));
    Measured m;
    m.outlined = false;
#if SKIP_DEPTH_EDGES
    vec4 across = across_a_jump(g);
    valid *= 1.0 - across;
    vec4 both = min(left, right);
    m.outlined = across != vec4(0.0) || min(least(both.xyz), both.w) < -0.5;
#endif
    valid *= part_at(first);
    // The first child stands for one that is not there.
    bvec2 whole = lessThan(first + 1, size);
    if (!whole.x) valid.yw = valid.xz;
    if (!whole.y) valid.zw = valid.xy;
    Pull p = pull_shares(valid, vec4(g.r1.yz, g.r2.yz), deepest);

    ChildBands b = child_bands(w, whole);
    m.bands = b;
    Moments at_a = moments_of(b.a), at_b = moments_of(b.b);
    Moments at_c = moments_of(b.c), at_d = moments_of(b.d);
#define MEAN(plane) mixed(p.share, at_a.plane, at_b.plane, at_c.plane, at_d.plane)
    m.moments = Moments(vec4(MEAN(magnitude).rgb, p.confidence), MEAN(itself), MEAN(blue), MEAN(red));
    return m;
}
