#version 430
// Products of the known colour's gradients, where all of it is of one surface.
// Twin: structure_tensors() in reference.py, its first half. Change both or neither.

#constant ROW  // work-group size, pixels in a row

layout(local_size_x = ROW) in;

layout(rgba32f) uniform readonly image2D image;
layout(r32f) uniform readonly image2D depth_m;
layout(rgba32f) uniform writeonly image2D gradients;  // xx, xy, yy; a: guide, -1 where there is none

uniform float depth_threshold;
uniform float z_near_m;
uniform ivec2 first;

float guide_at(ivec2 place) { return max(0.0, 1.0 - z_near_m / imageLoad(depth_m, place).r); }

void main() {
    ivec2 pixel = first + ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(image)))) return;
    vec4 result = vec4(0.0, 0.0, 0.0, -1.0);
    ivec2 last = imageSize(image) - 1;
    if (all(greaterThan(pixel, ivec2(0))) && all(lessThan(pixel, last))) {
        vec4 right = imageLoad(image, pixel + ivec2(1, 0)), below = imageLoad(image, pixel + ivec2(0, 1));
        vec4 left = imageLoad(image, pixel - ivec2(1, 0)), above = imageLoad(image, pixel - ivec2(0, 1));
        float known = min(min(right.a, left.a), min(above.a, below.a));
        float guide = guide_at(pixel);
        vec4 apart = abs(guide - vec4(guide_at(pixel + ivec2(1, 0)), guide_at(pixel + ivec2(0, 1)),
                                      guide_at(pixel - ivec2(1, 0)), guide_at(pixel - ivec2(0, 1))));
        if (min(known, imageLoad(image, pixel).a) >= 0.5
            && all(lessThanEqual(apart, vec4(depth_threshold)))) {
            vec3 x = 0.5 * (right.rgb - left.rgb), y = 0.5 * (below.rgb - above.rgb);
            result = vec4(dot(x, x), dot(x, y), dot(y, y), guide);
        }
    }
    imageStore(gradients, pixel, result);
}
