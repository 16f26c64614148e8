#version 430
// Motion of each source pixel, and its depth as the target sees it.
// Twin: flow_between() in pipeline/camera.py.

layout(local_size_x = 64) in;  // rows, as the warp reads what it writes

layout(r32f) uniform readonly image2D depth_m;
layout(rg32f) uniform writeonly image2D flow_px;
layout(r32f) uniform writeonly image2D target_depth_m;

uniform mat3 turn;         // target camera from source camera
uniform vec3 shift_m;      // the source's place, in the target's axes
uniform vec2 source_focal, source_centre, target_focal, target_centre;
uniform bool still;        // no rotation and equal lenses: the motion is an exact difference

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(flow_px)))) return;
    float depth = imageLoad(depth_m, pixel).r;
    vec2 start = vec2(pixel) + 0.5;
    vec3 ray = vec3((start - source_centre) / source_focal, 1.0);
    float inverse = 1.0 / depth;  // inf gives 0: what is infinitely far moves by rotation alone
    vec3 moved = turn * ray + shift_m * inverse;
    bool behind = !(moved.z > 0.0);
    vec2 flow = target_focal * moved.xy / moved.z + target_centre - start;
    if (still) {
        // The same with the large terms cancelled before they are rounded.
        vec2 shift = target_focal * (shift_m.xy - ray.xy * shift_m.z) * inverse;
        flow = shift / moved.z + (target_centre - source_centre);
    }
    float seen = isinf(depth) ? depth : moved.z * depth;
    imageStore(flow_px, pixel, vec4(behind ? vec2(0.0) : flow, 0.0, 0.0));
    imageStore(target_depth_m, pixel, vec4(behind ? 0.0 : seen));
}
