#version 430
// Low-pass and halve; a call makes 2x2 results from 6x6 pixels. a: 1 where no tap, at any
// level, was a hole or mixed two depths; MIXED where one mixed two depths; else 0.
// Twin: halve(), range_below() and spoiled_levels() in features/reference.py. Change both or neither.

#constant LOW_INNER   // taps of the 4x4 kernel, all positive: both offsets inner,
#constant LOW_MIXED   // one outer,
#constant LOW_OUTER   // both outer
#constant MIXED       // far below -1: so that the smallest tap still tells
#constant DEPTH_EDGES // 1: the first halving where depth jumps: results across a jump are MIXED

#include "tiles.glsl"

layout(rgba32f) uniform readonly image2D fine;
layout(rgba32f) uniform writeonly image2D coarse;

#if DEPTH_EDGES
layout(r32f) uniform readonly image2D depth_m;
uniform float z_near_m;
uniform float depth_threshold;

float depth_at(int x, int y) { return imageLoad(depth_m, ivec2(x, y)).r; }

// Smallest and largest depth of a row's four left (xy) and four right taps (zw).
vec4 extents(int y, int x, ivec2 last) {
    y = clamp(y, 0, last.y);
    float a = depth_at(max(x - 1, 0), y), b = depth_at(x, y);
    float c = depth_at(min(x + 1, last.x), y), d = depth_at(min(x + 2, last.x), y);
    float e = depth_at(min(x + 3, last.x), y), f = depth_at(min(x + 4, last.x), y);
    float low = min(c, d), high = max(c, d);
    return vec4(min(min(a, b), low), max(max(a, b), high), min(min(e, f), low), max(max(e, f), high));
}

vec2 guides(vec2 depths) { return max(vec2(0.0), 1.0 - z_near_m / depths); }

// True if the left and the right result mix depths, given their four rows. Guides grow with depth,
// rounded as well: the farthest depth has the largest.
bvec2 mixes(vec4 a, vec4 b, vec4 c, vec4 d) {
    vec2 nearest = min(min(a.xz, b.xz), min(c.xz, d.xz));
    vec2 farthest = max(max(a.yw, b.yw), max(c.yw, d.yw));
    return greaterThan(guides(farthest) - guides(nearest), vec2(depth_threshold));
}
#endif

// One row of pixels, weighed as an inner and as an outer row of the kernel.
struct Row {
    vec4 inner_left, outer_left, inner_right, outer_right;
};

// Differences from `origin` keep a constant exactly constant. a: 0 where clean.
Row weigh(int y, int x, ivec2 last, vec4 origin) {
    y = clamp(y, 0, last.y);
    vec4 a = imageLoad(fine, ivec2(max(x - 1, 0), y)) - origin;
    vec4 b = imageLoad(fine, ivec2(x, y)) - origin;
    vec4 c = imageLoad(fine, ivec2(min(x + 1, last.x), y)) - origin;
    vec4 d = imageLoad(fine, ivec2(min(x + 2, last.x), y)) - origin;
    vec4 e = imageLoad(fine, ivec2(min(x + 3, last.x), y)) - origin;
    vec4 f = imageLoad(fine, ivec2(min(x + 4, last.x), y)) - origin;
    return Row(LOW_MIXED * (a + d) + LOW_INNER * (b + c), LOW_OUTER * (a + d) + LOW_MIXED * (b + c),
               LOW_MIXED * (c + f) + LOW_INNER * (d + e), LOW_OUTER * (c + f) + LOW_MIXED * (d + e));
}

void store(ivec2 place, vec4 sum, vec4 origin, bool mixed) {
    if (all(lessThan(place, imageSize(coarse)))) {
        // Holes alone, however many, sum to -1 at the least.
        float clean = mixed || sum.a < -1.5 ? MIXED : sum.a == 0.0 ? 1.0 : 0.0;
        imageStore(coarse, place, vec4(origin.rgb + sum.rgb, clean));
    }
}

// `block` covers 2x2 pixels of the written resolution.
void work(ivec2 block, int chain) {
    ivec2 last = imageSize(fine) - 1;
    int x = min(4 * block.x, last.x), y = min(4 * block.y, last.y);
    vec4 origin = vec4(imageLoad(fine, ivec2(x, y)).rgb, 1.0);
    Row r0 = weigh(y - 1, x, last, origin), r1 = weigh(y, x, last, origin);
    Row r2 = weigh(y + 1, x, last, origin), r3 = weigh(y + 2, x, last, origin);
    Row r4 = weigh(y + 3, x, last, origin), r5 = weigh(y + 4, x, last, origin);
    bvec2 above = bvec2(false), below = bvec2(false);
#if DEPTH_EDGES
    vec4 e2 = extents(y + 1, x, last), e3 = extents(y + 2, x, last);
    above = mixes(extents(y - 1, x, last), extents(y, x, last), e2, e3);
    below = mixes(e2, e3, extents(y + 3, x, last), extents(y + 4, x, last));
#endif
    ivec2 place = 2 * block;
    store(place, r0.outer_left + r1.inner_left + r2.inner_left + r3.outer_left, origin, above.x);
    store(place + ivec2(1, 0), r0.outer_right + r1.inner_right + r2.inner_right + r3.outer_right,
          origin, above.y);
    store(place + ivec2(0, 1), r2.outer_left + r3.inner_left + r4.inner_left + r5.outer_left,
          origin, below.x);
    store(place + 1, r2.outer_right + r3.inner_right + r4.inner_right + r5.outer_right, origin,
          below.y);
}
