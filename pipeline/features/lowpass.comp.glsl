#version 430
// Low-pass and halve. a: 1 where no tap, at any level, was a hole.
// Twin: halve() and spoiled_levels() in reference.py. Change both or neither.

#constant LOW_INNER   // taps of the 4x4 kernel: both offsets inner,
#constant LOW_MIXED   // one outer,
#constant LOW_OUTER   // both outer

#include "tiles.glsl"

layout(rgba32f, binding = 0) uniform readonly image2D fine;
layout(rgba32f, binding = 1) uniform writeonly image2D coarse;

void work(ivec2 pixel) {
    ivec2 last = imageSize(fine) - 1;
    ivec2 b = 2 * pixel;
    ivec2 a = max(b - 1, ivec2(0));
    ivec2 c = min(b + 1, last);
    ivec2 d = min(b + 2, last);
#define AT(x, y) imageLoad(fine, ivec2(x, y))
    vec4 near = AT(b.x, b.y);
    vec4 inner_1 = AT(c.x, b.y), inner_2 = AT(b.x, c.y), inner_3 = AT(c.x, c.y);
    vec4 mixed_0 = AT(b.x, a.y), mixed_1 = AT(c.x, a.y), mixed_2 = AT(a.x, b.y);
    vec4 mixed_3 = AT(d.x, b.y), mixed_4 = AT(a.x, c.y), mixed_5 = AT(d.x, c.y);
    vec4 mixed_6 = AT(b.x, d.y), mixed_7 = AT(c.x, d.y);
    vec4 outer_0 = AT(a.x, a.y), outer_1 = AT(d.x, a.y), outer_2 = AT(a.x, d.y);
    vec4 outer_3 = AT(d.x, d.y);
    // Differences keep a constant exactly constant; alpha counts the clean taps.
    vec4 inner = (inner_1 - near) + (inner_2 - near) + (inner_3 - near);
    vec4 mixed = (mixed_0 - near) + (mixed_1 - near) + (mixed_2 - near) + (mixed_3 - near)
               + (mixed_4 - near) + (mixed_5 - near) + (mixed_6 - near) + (mixed_7 - near);
    vec4 outer = (outer_0 - near) + (outer_1 - near) + (outer_2 - near) + (outer_3 - near);
    vec3 low = near.rgb + LOW_INNER * inner.rgb + LOW_MIXED * mixed.rgb + LOW_OUTER * outer.rgb;
    bool clean = near.a == 1.0 && inner.a + mixed.a + outer.a == 0.0;
    imageStore(coarse, pixel, vec4(low, clean ? 1.0 : 0.0));
}
