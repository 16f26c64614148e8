#version 430
// Lay the detail on the base, as much of it as the base lacks.
// Twin: lacking() and shift_map_fill() in reference.py. Change both or neither.

#include "pixels.glsl"
#include "shift_blend.glsl"

layout(rgba32f) uniform image2D image;  // a: 1 known, 0 hole
layout(rg32f) uniform readonly image2D flow_px;
layout(rgba32f) uniform readonly image2D base;
layout(rgba32f) uniform readonly image2D detail;

uniform float gain;

vec2 squares(int tile) {
    return tiles[tile].count > 0 ? vec2(tiles[tile].there, tiles[tile].wanted) : vec2(0.0);
}

void finish(ivec2 pixel) {
    if (any(greaterThanEqual(pixel, imageSize(image)))) return;
    if (imageLoad(image, pixel).a >= 0.5) return;
    vec4 filled = imageLoad(base, pixel);
    if (filled.a > 0.0) {
        Blend around = blend_of(grid_subpixels(pixel, imageLoad(flow_px, pixel).rg));
        vec2 sums = around.share.x * squares(around.a) + around.share.y * squares(around.b)
                  + around.share.z * squares(around.c) + around.share.w * squares(around.d);
        float lacks = sqrt(clamp(1.0 - sums.x / max(sums.y, 1.0), 0.0, 1.0));
        filled.rgb += gain * filled.a * lacks * imageLoad(detail, pixel).rgb;
    }
    imageStore(image, pixel, vec4(clamp(filled.rgb, 0.0, 1.0), 0.0));
}

// `parent` is a pixel of resolution 1.
void work(ivec2 parent, int chain) {
    finish(2 * parent);
    finish(2 * parent + ivec2(1, 0));
    finish(2 * parent + ivec2(0, 1));
    finish(2 * parent + 1);
}
