#version 430
// Pack what the search compares, near the holes.
// Twin: planes_of() in tiles.py. Change both or neither.

#include "tiles.glsl"
#include "guided.glsl"
#include "shift_planes.glsl"

layout(rgba32f, binding = 0) uniform readonly image2D image;  // a: 1 known, 0 hole
layout(r32f, binding = 1) uniform readonly image2D depth_m;
layout(rgba32f, binding = 2) uniform readonly image2D base;
layout(rgba32f, binding = 3) uniform readonly image2D quarters;
layout(r32f, binding = 4) uniform readonly image2D quarter_guide;
layout(rg32ui, binding = 5) uniform writeonly uimage2D planes;

uniform float z_near_m;

#include "quarters.glsl"

void pack(ivec2 pixel) {
    if (any(greaterThanEqual(pixel, imageSize(planes)))) return;
    vec4 shown = imageLoad(image, pixel);
    bool hole = shown.a < 0.5;
    if (hole) shown = imageLoad(base, pixel);
    float guide = max(0.0, 1.0 - z_near_m / imageLoad(depth_m, pixel).r);
    uvec2 found = planes_of(steps_of(shown.rgb), steps_of(low_at(pixel, guide)),
                            guide_steps_of(guide), hole);
    imageStore(planes, pixel, uvec4(found, 0u, 0u));
}

// `parent` is a pixel of resolution 1.
void work(ivec2 parent, int chain) {
    pack(2 * parent);
    pack(2 * parent + ivec2(1, 0));
    pack(2 * parent + ivec2(0, 1));
    pack(2 * parent + 1);
}
