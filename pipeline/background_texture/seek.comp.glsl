#version 430
// Seek: from where in the frame each hole pixel takes its texture.
// Twin: texture_origins() in reference.py. Change both or neither.

#constant STEP_0    // steps along the parallax, tried in turn
#constant STEP_1
#constant STEP_2
#constant INSET     // past mixed border pixels

#include "pixels.glsl"
#include "guided.glsl"

layout(rgba32f) uniform readonly image2D image;  // a: 1 known, 0 hole
layout(r32f) uniform readonly image2D depth_m;
layout(rg32f) uniform readonly image2D flow_px;  // target minus source
layout(rg32f) uniform writeonly image2D origin;  // x, y; negative: none

#include "background_texture/sides.glsl"

const vec2 NOWHERE = vec2(-1.0);

// The point that many whole steps ahead, or NOWHERE if what lies there is of no use.
vec2 point_at(ivec2 pixel, vec2 flow, float guide, Side side, float distance_px, int step) {
    ivec2 place = pixel + step * int(ceil(distance_px / float(step))) * side.direction;
    if (!is_background(place, guide)) return NOWHERE;
    // Motion that varies over the background must not make the texture glide.
    vec2 point = vec2(place) + (flow_at(place) - flow);
    ivec2 low = ivec2(floor(point)), high = ivec2(ceil(point));
    bool usable = is_background(low, guide) && is_background(high, guide)
        && is_background(ivec2(low.x, high.y), guide)
        && is_background(ivec2(high.x, low.y), guide);
    return usable ? point + 0.5 : NOWHERE;
}

vec2 origin_of(ivec2 pixel) {
    float guide = guide_at(pixel);
    Side side = background_side(pixel, guide);
    if (side.steps == 0) return NOWHERE;
    vec2 flow = flow_at(pixel);
    ivec2 border = pixel + side.steps * side.direction;
    vec2 between = abs(roundEven(vec2(border) - flow_at(border)) - (vec2(pixel) - flow));
    float distance_px = max(between.x, between.y) + INSET;
    vec2 point = point_at(pixel, flow, guide, side, distance_px, STEP_0);
    if (point.x < 0.0) point = point_at(pixel, flow, guide, side, distance_px, STEP_1);
    if (point.x < 0.0) point = point_at(pixel, flow, guide, side, distance_px, STEP_2);
    return point;
}

// `parent` is a pixel of resolution 1.
void work(ivec2 parent, int chain) {
    for (int child = 0; child < 4; ++child) {
        ivec2 pixel = 2 * parent + ivec2(child & 1, child >> 1);
        if (is_inside(pixel) && is_hole(pixel)) {
            imageStore(origin, pixel, vec4(origin_of(pixel), 0.0, 0.0));
        }
    }
}
