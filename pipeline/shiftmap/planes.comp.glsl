#version 430
// Pack what the search compares, near the holes.
// Twin: planes_of() in tiles.py. Change both or neither.

#include "tiles.glsl"
#include "guided.glsl"
#include "shift_planes.glsl"

layout(rgba32f) uniform readonly image2D image;  // a: 1 known, 0 hole
layout(r32f) uniform readonly image2D depth_m;
layout(rgba32f) uniform readonly image2D base;
layout(rgba32f) uniform readonly image2D quarters;
layout(r32f) uniform readonly image2D quarter_guide;
layout(rg32ui) uniform writeonly uimage2D planes;

uniform float z_near_m;

#include "quarters.glsl"

void pack(ivec2 pixel, float guide, ivec3 low) {
    vec4 shown = imageLoad(image, pixel);
    bool hole = shown.a < 0.5;
    if (hole) shown = imageLoad(base, pixel);
    uvec2 found = planes_of(steps_of(shown.rgb), low, guide_steps_of(guide), hole);
    imageStore(planes, pixel, uvec4(found, 0u, 0u));
}

// `parent` is a pixel of resolution 1.
void work(ivec2 parent, int chain) {
    // An odd border repeats its last pixel, which then is packed twice.
    Taps taps = children_of(parent, imageSize(planes));
    vec4 guides = max(vec4(0.0), 1.0 - z_near_m / GUIDES_AT(depth_m, taps));
    ivec3 low = steps_of(half_low_at(taps.a, farthest(guides)));
    pack(taps.a, guides.x, low);
    pack(taps.b, guides.y, low);
    pack(taps.c, guides.z, low);
    pack(taps.d, guides.w, low);
}
