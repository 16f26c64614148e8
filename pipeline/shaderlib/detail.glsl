// The background's own detail, in place of noise. Include it where LEVELS, `image` and
// bilinear() are.
// Twin: details() in background_texture/reference.py, shaped_detail() in synthesis/reference.py.

#constant DETAIL_LIMIT  // deviations: more of the background's detail is another object's edge

layout(rg32f) uniform readonly image2D origin;  // x, y; negative: none
uniform sampler2D coarser[LEVELS];  // levels 1 and on of the filled frame

// All four taps are known pixels, which nobody writes.
vec3 frame_at(vec2 point) {
    vec2 place = point - 0.5;
    ivec2 low = ivec2(floor(place)), high = ivec2(ceil(place));
    vec4 share = bilinear(place - floor(place));
    return share.x * imageLoad(image, low).rgb
         + share.y * imageLoad(image, ivec2(high.x, low.y)).rgb
         + share.z * imageLoad(image, ivec2(low.x, high.y)).rgb
         + share.w * imageLoad(image, high).rgb;
}

// The next coarser level at a point of full size, borders repeated.
vec3 coarser_at(int level, vec2 point) {
    vec2 place = point / float(2 << level) - 0.5;
    ivec2 last = textureSize(coarser[level], 0) - 1;
    ivec2 corner = ivec2(floor(place));
    ivec2 low = clamp(corner, ivec2(0), last), high = clamp(corner + 1, ivec2(0), last);
    vec4 share = bilinear(place - floor(place));
    return share.x * texelFetch(coarser[level], low, 0).rgb
         + share.y * texelFetch(coarser[level], ivec2(high.x, low.y), 0).rgb
         + share.z * texelFetch(coarser[level], ivec2(low.x, high.y), 0).rgb
         + share.w * texelFetch(coarser[level], high, 0).rgb;
}

// So much of a level's detail as the base lacks and as can be texture. Amplitudes of its bands.
vec3 shaped_detail(vec3 detail, float gain, vec3 high, vec3 along_x, vec3 along_y) {
    vec3 limit = DETAIL_LIMIT * sqrt(high * high + along_x * along_x + along_y * along_y);
    return clamp(gain * detail, -limit, limit);
}
