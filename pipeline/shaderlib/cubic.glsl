// Pictures looked up between pixels by a cubic spline. Twin: look_up_cubic() in foveation/displacement.py.

#constant CUBIC  // Keys' parameter

// Four indices from `first` on, at most 3 beyond the picture: reflected at borders that repeat.
ivec4 mirrored(int first, int count) {
    ivec4 index = first + ivec4(0, 1, 2, 3);
    index = max(index, -1 - index);
    return clamp(min(index, 2 * count - 1 - index), 0, count - 1);
}

// Four indices from `first` on in what goes on at its other side.
ivec4 around(float first, int count) {
    // Within a whole turn; its rounding may leave one more.
    ivec4 index = int(first - float(count) * floor(first / float(count))) + ivec4(0, 1, 2, 3);
    index -= count * ivec4(greaterThanEqual(index, ivec4(count)));
    return clamp(index, 0, count - 1);
}

float near(float t) { return ((CUBIC + 2.0) * t - (CUBIC + 3.0)) * t * t + 1.0; }
float far(float t) { return CUBIC * (((t - 5.0) * t + 8.0) * t - 4.0); }
vec4 cubic(float t) { return vec4(far(1.0 + t), near(t), near(1.0 - t), far(2.0 - t)); }

vec3 row_at(sampler2D image, ivec4 x, int y, vec4 w) {
    return w.x * texelFetch(image, ivec2(x.x, y), 0).rgb + w.y * texelFetch(image, ivec2(x.y, y), 0).rgb
         + w.z * texelFetch(image, ivec2(x.z, y), 0).rgb + w.w * texelFetch(image, ivec2(x.w, y), 0).rgb;
}

// At a place; `wraps`: the picture goes on at its other side.
vec3 look_up(sampler2D image, vec2 place, bool wraps) {
    ivec2 size = textureSize(image, 0);
    vec2 at = place - 0.5, corner = floor(at);
    vec4 wx = cubic(at.x - corner.x), wy = cubic(at.y - corner.y);
    ivec4 x = wraps ? around(corner.x - 1.0, size.x) : mirrored(int(corner.x) - 1, size.x);
    ivec4 y = mirrored(int(corner.y) - 1, size.y);
    return wy.x * row_at(image, x, y.x, wx) + wy.y * row_at(image, x, y.y, wx)
         + wy.z * row_at(image, x, y.z, wx) + wy.w * row_at(image, x, y.w, wx);
}
