#version 430
// From every hole pixel to its end on the background's side, and the other way to the hole's end.
// Twin: find_ways() and nearer_around() in base.py. Change both or neither.

#constant THIN_PX       // across a hole: from here up,
#constant WIDE_PX       // and from here on, it is not thin; one open behind is so much wider
#constant NEARER_SHARE  // of the base of a thin hole whose background is in sight nowhere

#include "pixels.glsl"
#include "guided.glsl"

layout(rgba32f) uniform readonly image2D image;
layout(r32f) uniform readonly image2D depth_m;
layout(rg32f) uniform readonly image2D flow_px;
layout(rgba32f) uniform readonly image2D quarters;
layout(r32f) uniform readonly image2D quarter_guide;
layout(rgba32i) uniform writeonly iimage2D ways;  // step x, y; steps; width
layout(rgba32f) uniform writeonly image2D ends;   // low-pass and guide there; if none: see below

#include "sides.glsl"
#include "quarters.glsl"
#include "thickness.glsl"

int hole_pixels_behind(ivec2 pixel, ivec2 direction) {
    for (int count = 0; count < REACH; ++count) {
        ivec2 place = pixel - (count + 1) * direction;
        if (!is_inside(place)) return count + WIDE_PX;
        if (!is_hole(place)) return count;
    }
    return REACH;
}

vec4 end_of_ray(ivec2 pixel, ivec2 direction, int steps) {
    if (steps == 0) return vec4(0.0);
    float length_px = float(steps) * sqrt(float(direction.x * direction.x + direction.y * direction.y));
    return vec4(imageLoad(image, pixel + steps * direction).rgb, 1.0) / length_px;
}

// The mean colour where eight rays end, nearer ends counting more; a: its share of the base.
vec4 nearer_around(ivec2 pixel) {
    vec4 total = vec4(0.0);
    int across_px = WIDE_PX;
    for (int number = 0; number < 4; ++number) {
        ivec2 direction = octant(number);
        int one = steps_to_known(pixel, direction, REACH);
        int other = steps_to_known(pixel, -direction, REACH);
        // Along rows and columns: diagonals are short in every corner.
        if (number % 2 == 0 && one > 0 && other > 0) across_px = min(across_px, one + other - 1);
        total += end_of_ray(pixel, direction, one) + end_of_ray(pixel, -direction, other);
    }
    if (total.a == 0.0) return vec4(0.0);
    return vec4(total.rgb / total.a, NEARER_SHARE * (1.0 - thickness(across_px)));
}

// Steps to the first known pixel of the hole pixel's own surface, past all else; 0: none.
int steps_through(ivec2 pixel, ivec2 direction, float guide, int reach) {
    ivec2 place = pixel;
    for (int count = 1; count <= reach; ++count) {
        place += direction;
        if (!is_inside(place)) return 0;
        if (abs(guide - guide_at(place)) <= depth_threshold && !is_hole(place)) return count;
    }
    return 0;
}

Side through(ivec2 pixel, ivec2 direction, float guide) {
    if (direction == ivec2(0)) return Side(direction, 0);
    int one = steps_through(pixel, direction, guide, REACH);
    int other = steps_through(pixel, -direction, guide, one > 0 ? one - 1 : REACH);
    return other > 0 ? Side(-direction, other) : Side(direction, one);
}

void find_way(ivec2 pixel) {
    float guide = guide_at(pixel);
    Side side = background_side(pixel, guide);
    int across_px = WIDE_PX;
    if (side.steps > 0) {
        across_px = min(side.steps + hole_pixels_behind(pixel, side.direction), REACH);
    } else {
        vec4 nearer = nearer_around(pixel);
        if (nearer.a == 0.0) side = through(pixel, side.direction, guide);
        if (side.steps == 0) {
            imageStore(ways, pixel, ivec4(0));
            imageStore(ends, pixel, nearer);
            return;
        }
    }
    ivec2 end = pixel + side.steps * side.direction;
    // Past the mixed colours of a silhouette, where what comes next is background too.
    if (is_background(end + side.direction, guide)) end += side.direction;
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
