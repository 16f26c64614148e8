#version 430
// From every hole pixel to its end on the background's side, and the other way to the hole's end.
// Twin: find_ways() in base.py. Change both or neither.

#constant WIDE_PX  // a hole that is open behind is as wide as the way says, and this more

#include "pixels.glsl"
#include "guided.glsl"

layout(rgba32f) uniform readonly image2D image;
layout(r32f) uniform readonly image2D depth_m;
layout(rg32f) uniform readonly image2D flow_px;
layout(rgba32f) uniform readonly image2D quarters;
layout(r32f) uniform readonly image2D quarter_guide;
layout(rgba32i) uniform writeonly iimage2D ways;  // step x, y; steps; width
layout(rgba32f) uniform writeonly image2D ends;   // low-pass and guide there

#include "sides.glsl"
#include "quarters.glsl"

int hole_pixels_behind(ivec2 pixel, ivec2 direction) {
    for (int count = 0; count < REACH; ++count) {
        ivec2 place = pixel - (count + 1) * direction;
        if (!is_inside(place)) return count + WIDE_PX;
        if (!is_hole(place)) return count;
    }
    return REACH;
}

void find_way(ivec2 pixel) {
    float guide = guide_at(pixel);
    Side side = background_side(pixel, guide);
    if (side.steps == 0) {
        imageStore(ways, pixel, ivec4(0));
        return;
    }
    ivec2 end = pixel + side.steps * side.direction;
    // Past the mixed colours of a silhouette, where what comes next is background too.
    if (is_background(end + side.direction, guide)) end += side.direction;
    int across_px = min(side.steps + hole_pixels_behind(pixel, side.direction), REACH);
    imageStore(ways, pixel, ivec4(side.direction, side.steps, across_px));
    float end_guide = guide_at(end);
    imageStore(ends, pixel, vec4(low_at(end, end_guide), end_guide));
}

// `parent` is a pixel of resolution 1.
void work(ivec2 parent, int chain) {
    for (int child = 0; child < 4; ++child) {
        ivec2 pixel = 2 * parent + ivec2(child & 1, child >> 1);
        if (is_inside(pixel) && is_hole(pixel)) find_way(pixel);
    }
}
