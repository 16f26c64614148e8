#version 430
// Displace: look the picture up at x + D(x), by a cubic spline.
// Twin: displaced() in displacement.py; finished() in reference.py. Change both or neither.

#constant TILE            // work-group edge, pixels
#constant LEAST_VARIANCE  // of the field's pools, over HALVED_VARIANCE
#constant REACH           // deviations from the border within which the displacement fades out
#constant CUBIC           // Keys' parameter
#constant HALVINGS        // of the field's noise, at most

#include "pools.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

layout(binding = 0) uniform sampler2D source;
layout(binding = 1) uniform sampler2D field;  // chosen noise
layout(rgba32f, binding = 0) uniform writeonly image2D warped;
uniform float reach, smoothness;
// Variance of a level's noise, covariance with and variance of the next one's; see white_energies().
uniform vec3 energies[HALVINGS + 2];

// Four indices from `first` on, reflected at borders that repeat. No remainder of a negative number:
// GLSL leaves it open.
ivec4 mirrored(int first, int count) {
    ivec4 index = (first + 16 * count + ivec4(0, 1, 2, 3)) % (2 * count);
    return min(index, 2 * count - 1 - index);
}

ivec4 columns_from(int first, int count) {
#if EQUIRECTANGULAR
    return (first + 16 * count + ivec4(0, 1, 2, 3)) % count;
#else
    return mirrored(first, count);
#endif
}

float near(float t) { return ((CUBIC + 2.0) * t - (CUBIC + 3.0)) * t * t + 1.0; }
float far(float t) { return CUBIC * (((t - 5.0) * t + 8.0) * t - 4.0); }
vec4 cubic(float t) { return vec4(far(1.0 + t), near(t), near(1.0 - t), far(2.0 - t)); }

vec3 row_at(ivec4 x, int y, vec4 w) {
    return w.x * texelFetch(source, ivec2(x.x, y), 0).rgb + w.y * texelFetch(source, ivec2(x.y, y), 0).rgb
         + w.z * texelFetch(source, ivec2(x.z, y), 0).rgb + w.w * texelFetch(source, ivec2(x.w, y), 0).rgb;
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy), size = imageSize(warped);
    if (any(greaterThanEqual(pixel, size))) return;
    vec2 place = vec2(pixel) + 0.5;
    float pool = pool_at(seen_at(place));
    float field_pool = max(smoothness * smoothness * pool, LEAST_VARIANCE);
    int level = min(int(floor(0.5 * log2(field_pool + 1.0))), HALVINGS);
    float share = level == HALVINGS ? 0.0 : beyond_lod(field_pool, level), rest = 1.0 - share;
    vec3 energy = energies[level];
    float variance = rest * rest * energy.x + 2.0 * share * rest * energy.y + share * share * energy.z;
    float away = reach * sqrt(pool * HALVED_VARIANCE);
    vec2 inside = min(place, vec2(size) - place);
#if EQUIRECTANGULAR
    float margin = inside.y;
#else
    float margin = min(inside.x, inside.y);
#endif
    away *= clamp(margin / max(REACH * away, 1e-9), 0.0, 1.0);
    vec2 at = place + away * inversesqrt(variance) * texelFetch(field, pixel, 0).rg - 0.5;
    vec2 corner = floor(at);
    vec4 wx = cubic(at.x - corner.x), wy = cubic(at.y - corner.y);
    ivec4 x = columns_from(int(corner.x) - 1, size.x), y = mirrored(int(corner.y) - 1, size.y);
    vec3 colour = wy.x * row_at(x, y.x, wx) + wy.y * row_at(x, y.y, wx)
                + wy.z * row_at(x, y.z, wx) + wy.w * row_at(x, y.w, wx);
    imageStore(warped, pixel, vec4(colour, 1.0));
}
