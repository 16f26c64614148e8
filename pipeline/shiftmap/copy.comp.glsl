#version 430
// Copy the detail of the known background to every hole pixel that is not thin, and sum per tile how
// much there is and how much the base has.
// Twin: shifted() in tiles.py, lacking() in reference.py. Change both or neither.

#constant EXTENSION_SHARE  // of the base where a hole is not thin
#constant SQUARE_STEPS     // squares are summed in these

#include "pixels.glsl"
#include "guided.glsl"
#include "shift_blend.glsl"
#include "ycbcr.glsl"

layout(rgba32f) uniform readonly image2D image;  // a: 1 known, 0 hole
layout(r32f) uniform readonly image2D depth_m;
layout(rg32f) uniform readonly image2D flow_px;
layout(rgba32f) uniform readonly image2D base;
layout(rgba32f) uniform readonly image2D quarters;
layout(r32f) uniform readonly image2D quarter_guide;
layout(rgba32f) uniform writeonly image2D detail;

uniform float z_near_m;

#include "quarters.glsl"

float guide_at(ivec2 place) { return max(0.0, 1.0 - z_near_m / imageLoad(depth_m, place).r); }

bool is_inside(ivec2 place) {
    return all(greaterThanEqual(place, ivec2(0))) && all(lessThan(place, imageSize(image)));
}

uint square_steps(vec3 colour) {
    float luma = dot(vec3(YCBCR_FROM_RGB[0].x, YCBCR_FROM_RGB[1].x, YCBCR_FROM_RGB[2].x), colour);
    return uint(roundEven(float(SQUARE_STEPS) * (luma * luma)));
}

// What one tile brings; a: its sharpened share, 0 if it has no source.
vec4 brought(ivec2 pixel, float guide, int tile, ivec2 shift, float bilinear) {
    ivec2 place = pixel + shift;
    if (tiles[tile].count == 0 || !is_inside(place)) return vec4(0.0);
    vec4 source = imageLoad(image, place);
    float there = guide_at(place);
    if (source.a < 0.5 || guide - there > depth_threshold) return vec4(0.0);
    float share = bilinear * bilinear * bilinear;
    return vec4(source.rgb - low_at(place, there), share);
}

// Of the four alone that have a source.
vec3 least(vec4 brought) { return brought.a > 0.0 ? brought.rgb : vec3(2.0); }

vec3 most(vec4 brought) { return brought.a > 0.0 ? brought.rgb : vec3(-2.0); }

float shared_power(vec4 a, ivec2 shift_a, vec4 b, ivec2 shift_b) {
    return shift_a == shift_b ? 2.0 * a.a * b.a : 0.0;
}

void copy(ivec2 pixel) {
    if (!is_inside(pixel)) return;
    vec4 pushed = imageLoad(image, pixel);
    if (pushed.a >= 0.5) return;
    float wide = imageLoad(base, pixel).a;
    if (wide <= 0.0) return;
    float guide = guide_at(pixel);
    Blend around = blend_of(grid_subpixels(pixel, imageLoad(flow_px, pixel).rg));
    ivec2 shift_a = tiles[around.a].shift[0], shift_b = tiles[around.b].shift[0];
    ivec2 shift_c = tiles[around.c].shift[0], shift_d = tiles[around.d].shift[0];
    vec4 a = brought(pixel, guide, around.a, shift_a, around.share.x);
    vec4 b = brought(pixel, guide, around.b, shift_b, around.share.y);
    vec4 c = brought(pixel, guide, around.c, shift_c, around.share.z);
    vec4 d = brought(pixel, guide, around.d, shift_d, around.share.w);
    float power = a.a * a.a + b.a * b.a + c.a * c.a + d.a * d.a
        + shared_power(a, shift_a, b, shift_b) + shared_power(a, shift_a, c, shift_c)
        + shared_power(a, shift_a, d, shift_d) + shared_power(b, shift_b, c, shift_c)
        + shared_power(b, shift_b, d, shift_d) + shared_power(c, shift_c, d, shift_d);
    vec3 copied = vec3(0.0);
    if (power > 0.0) {
        copied = (a.a * a.rgb + b.a * b.rgb + c.a * c.rgb + d.a * d.rgb) / sqrt(power);
        copied = clamp(copied, min(min(least(a), least(b)), min(least(c), least(d))),
                       max(max(most(a), most(b)), max(most(c), most(d))));
    }
    imageStore(detail, pixel, vec4(copied, 0.0));
    vec3 own = (1.0 - EXTENSION_SHARE * wide) * (pushed.rgb - low_at(pixel, guide));
    atomicAdd(tiles[around.own].there, square_steps(own));
    atomicAdd(tiles[around.own].wanted, square_steps(copied));
}

// `parent` is a pixel of resolution 1.
void work(ivec2 parent, int chain) {
    copy(2 * parent);
    copy(2 * parent + ivec2(1, 0));
    copy(2 * parent + ivec2(0, 1));
    copy(2 * parent + 1);
}
