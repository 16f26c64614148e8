#version 430
// Colours of a second picture in the holes of the first.
// Twin: completed() in reference.py.

#constant TILE

layout(local_size_x = TILE, local_size_y = TILE) in;

layout(rgba32f) uniform image2D colour;  // a: 1 known, 0 hole
layout(r32f) uniform writeonly image2D depth_m;
layout(rg32f) uniform writeonly image2D flow_px;
layout(rgba32f) uniform readonly image2D second_colour;
layout(r32f) uniform readonly image2D second_depth_m;
layout(rg32f) uniform readonly image2D second_flow_px;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(colour)))) return;
    vec4 seen = imageLoad(second_colour, pixel);
    if (imageLoad(colour, pixel).a != 0.0 || seen.a == 0.0) return;
    imageStore(colour, pixel, seen);
    imageStore(depth_m, pixel, imageLoad(second_depth_m, pixel));
    imageStore(flow_px, pixel, imageLoad(second_flow_px, pixel));
}
