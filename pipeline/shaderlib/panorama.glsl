// A panorama looked up in a direction, by a cubic spline. Twin: seen_in() in foveation/panorama.py.
// Change both or neither.

#include "cubic.glsl"

// A row that may lie beyond a pole, where the other meridian comes back.
vec3 row_over(sampler2D panorama, ivec4 x, int y, ivec2 size, vec4 w) {
    int inside = clamp(max(min(y, 2 * size.y - 1 - y), -1 - y), 0, size.y - 1);
    return row_at(panorama, y == inside ? x : (x + size.x / 2) % size.x, inside, w);
}

vec3 seen_in(sampler2D panorama, vec3 ray) {
    const float pi = 3.14159265358979;
    ivec2 size = textureSize(panorama, 0);
    vec2 share = vec2(atan(ray.x, ray.z) / (2.0 * pi), atan(ray.y, length(ray.xz)) / pi) + 0.5;
    vec2 at = share * vec2(size) - 0.5, corner = floor(at);
    vec4 wx = cubic(at.x - corner.x), wy = cubic(at.y - corner.y);
    ivec4 x = around(corner.x - 1.0, size.x);
    int y = int(corner.y) - 1;
    return wy.x * row_over(panorama, x, y, size, wx) + wy.y * row_over(panorama, x, y + 1, size, wx)
         + wy.z * row_over(panorama, x, y + 2, size, wx) + wy.w * row_over(panorama, x, y + 3, size, wx);
}
