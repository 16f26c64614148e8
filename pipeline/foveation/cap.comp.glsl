#version 430
// Cap: what is seen around a pole of a panorama, cubic between its pixels.
// Twin: cap_picture() in panorama.py. Change both or neither.

#constant TILE  // work-group edge, pixels

#include "pools.glsl"
#include "cubic.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform sampler2D panorama;
layout(rgba32f) uniform writeonly image2D cap;

// A row that may lie beyond a pole, where the other meridian comes back.
vec3 row_over(ivec4 x, int y, ivec2 size, vec4 w) {
    int inside = clamp(max(min(y, 2 * size.y - 1 - y), -1 - y), 0, size.y - 1);
    return row_at(panorama, y == inside ? x : (x + size.x / 2) % size.x, inside, w);
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy), size = textureSize(panorama, 0);
    if (any(greaterThanEqual(pixel, imageSize(cap)))) return;
    vec3 ray = seen_at(vec2(pixel) + 0.5).ray;
    vec2 share = vec2(atan(ray.x, ray.z) / (2.0 * PI), atan(ray.y, length(ray.xz)) / PI) + 0.5;
    vec2 at = share * vec2(size) - 0.5, corner = floor(at);
    vec4 wx = cubic(at.x - corner.x), wy = cubic(at.y - corner.y);
    ivec4 x = around(corner.x - 1.0, size.x);
    int y = int(corner.y) - 1;
    vec3 colour = wy.x * row_over(x, y, size, wx) + wy.y * row_over(x, y + 1, size, wx)
                + wy.z * row_over(x, y + 2, size, wx) + wy.w * row_over(x, y + 3, size, wx);
    imageStore(cap, pixel, vec4(clamp(colour, 0.0, 1.0), 1.0));
}
