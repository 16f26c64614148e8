#version 430
// Composite: weigh every band's noise, look it up where the background comes from, and add
// it to the base, in hole pixels only, in place.
// Twin: shaped_noise(), look_up() and sample() in reference.py. Change both or neither.

#constant LEVELS
#constant MOST_LEVELS
#constant CHANNELS  // of noise: 1 or 3
#constant PLANES    // layers per chain of moments
#constant NOISE_TILE
#constant ANCHOR    // 0: screen, 1: inpainted motion, 2: depth and two cameras

#include "tiles.glsl"
#include "guided.glsl"

layout(rgba32f, binding = 0) uniform image2D image;  // rgb: encoded colour; a: 1 known, 0 hole
layout(binding = 0) uniform sampler2D depth_m;
layout(binding = 1) uniform sampler2DArray base;     // at resolution 1: motion, guide
layout(binding = 2) uniform sampler2DArray noise;    // layer level * CHANNELS + channel; rgb: bands
// Amplitudes of level k, at resolution k + 1.
layout(binding = 3) uniform sampler2DArray amplitudes_0;
layout(binding = 4) uniform sampler2DArray amplitudes_1;
layout(binding = 5) uniform sampler2DArray amplitudes_2;
layout(binding = 6) uniform sampler2DArray amplitudes_3;
layout(binding = 7) uniform sampler2DArray amplitudes_4;
layout(binding = 8) uniform sampler2DArray amplitudes_5;

uniform float z_near_m;
uniform float noise_scale;
uniform ivec2 level_size[MOST_LEVELS];     // of the amplitudes
uniform vec4 lag_correlation[LEVELS * 3];  // lags (0, 1), (1, 0), (1, 1), (1, -1)
#if ANCHOR == 2
uniform mat4 source_from_target;
#endif

const mat3 RGB_FROM_YCBCR = mat3(1.0, 1.0, 1.0,
                                 0.0, -0.0722 * 1.8556 / 0.7152, 1.8556,
                                 1.5748, -0.2126 * 1.5748 / 0.7152, 0.0);

vec4 bilinear(vec2 fraction) {
    vec2 rest = 1.0 - fraction;
    return vec4(rest.x * rest.y, fraction.x * rest.y, rest.x * fraction.y, fraction.x * fraction.y);
}

// The taps' own shares, those nearer than the pixel left out.
vec4 guided(vec4 share, float guide, vec4 guides) {
    share *= vec4(lessThanEqual(guide - guides, vec4(depth_threshold)));
    float total = dot(share, vec4(1.0));
    return total > 0.0 ? share / total : vec4(0.0);
}

vec2 anchor(ivec2 pixel, float guide, float depth) {
    vec2 here = vec2(pixel) + 0.5;
#if ANCHOR == 1
    ivec2 last = textureSize(base, 0).xy - 1;
    ivec2 a = pixel >> 1;
    ivec2 d = clamp(a + 2 * (pixel & 1) - 1, ivec2(0), last);
    vec4 texel_a = texelFetch(base, ivec3(a, 1), 0);
    vec4 texel_b = texelFetch(base, ivec3(d.x, a.y, 1), 0);
    vec4 texel_c = texelFetch(base, ivec3(a.x, d.y, 1), 0);
    vec4 texel_d = texelFetch(base, ivec3(d, 1), 0);
    vec4 share = push_shares(guide, vec4(texel_a.w, texel_b.w, texel_c.w, texel_d.w));
    return here - mixed(share, texel_a, texel_b, texel_c, texel_d).xy;
#elif ANCHOR == 2
    vec4 point = source_from_target * vec4(here, 1.0, 1.0 / depth);
    return point.xy / point.z;
#else
    return here;
#endif
}

// Noise texels of all bands between four neighbours, `corner` the upper left.
vec3 noise_between(ivec2 corner, vec4 w, int layer) {
    ivec2 p = corner & (NOISE_TILE - 1);
    vec3 texel = texelFetch(noise, ivec3(p, layer), 0).rgb;
    if (w.x == 1.0) return texel;
    ivec2 q = (corner + 1) & (NOISE_TILE - 1);
    return w.x * texel + w.y * texelFetch(noise, ivec3(q.x, p.y, layer), 0).rgb
         + w.z * texelFetch(noise, ivec3(p.x, q.y, layer), 0).rgb
         + w.w * texelFetch(noise, ivec3(q, layer), 0).rgb;
}

#define AMPLITUDE(source, layer)                                                       \
    mixed(share, texelFetch(source, ivec3(a, layer), 0),                                \
          texelFetch(source, ivec3(b, layer), 0), texelFetch(source, ivec3(c, layer), 0), \
          texelFetch(source, ivec3(d, layer), 0)).rgb

#if CHANNELS == 1
#define CHANNELS_OF(b) vec3(one[b])
#else
#define CHANNELS_OF(b) vec3(one[b], two[b], three[b])
#endif

// One level's contribution. A macro, because a sampler cannot be chosen at run time.
#define ADD_LEVEL(k, source)                                                           \
    {                                                                                  \
        vec2 place = (vec2(pixel) + 0.5) * (0.5 / float(1 << k)) - 0.5;                \
        vec2 floored = floor(place);                                                   \
        ivec2 last = level_size[k] - 1;                                                \
        ivec2 a = clamp(ivec2(floored), ivec2(0), last);                               \
        ivec2 d = clamp(ivec2(floored) + 1, ivec2(0), last);                           \
        ivec2 b = ivec2(d.x, a.y);                                                     \
        ivec2 c = ivec2(a.x, d.y);                                                     \
        const int guide_layer = k * PLANES + PLANES - 1;                               \
        vec4 share = guided(bilinear(place - floored), guide,                          \
                            vec4(texelFetch(source, ivec3(a, guide_layer), 0).w,       \
                                 texelFetch(source, ivec3(b, guide_layer), 0).w,       \
                                 texelFetch(source, ivec3(c, guide_layer), 0).w,       \
                                 texelFetch(source, ivec3(d, guide_layer), 0).w));     \
        vec3 one = noise_between(corner, w, k * CHANNELS);                             \
        MORE_NOISE(k)                                                                  \
        total += AMPLITUDE(source, k * PLANES) * CHANNELS_OF(0) * gain(k * 3);         \
        total += AMPLITUDE(source, k * PLANES + 1) * CHANNELS_OF(1) * gain(k * 3 + 1); \
        total += AMPLITUDE(source, k * PLANES + 2) * CHANNELS_OF(2) * gain(k * 3 + 2); \
    }
#if CHANNELS == 1
#define MORE_NOISE(k)
#else
#define MORE_NOISE(k)                                         \
    vec3 two = noise_between(corner, w, k * CHANNELS + 1);    \
    vec3 three = noise_between(corner, w, k * CHANNELS + 2);
#endif
// Interpolated noise has less variance; see look_up().
#define gain(i) inversesqrt(self + dot(lag, lag_correlation[i]))

void work(ivec2 pixel) {
    vec4 texel = imageLoad(image, pixel);
    if (texel.a >= 0.5) return;
    float depth = texelFetch(depth_m, pixel, 0).r;
    float guide = max(0.0, 1.0 - z_near_m / depth);

    vec2 noise_place = anchor(pixel, guide, depth) - 0.5;
    ivec2 corner = ivec2(floor(noise_place));
    vec4 w = bilinear(noise_place - vec2(corner));
    float self = dot(w, w);
    vec4 lag = 2.0 * vec4(w.x * w.y + w.z * w.w, w.x * w.z + w.y * w.w, w.x * w.w, w.y * w.z);

    vec3 total = vec3(0.0);
    ADD_LEVEL(0, amplitudes_0)
#if LEVELS > 1
    ADD_LEVEL(1, amplitudes_1)
#endif
#if LEVELS > 2
    ADD_LEVEL(2, amplitudes_2)
#endif
#if LEVELS > 3
    ADD_LEVEL(3, amplitudes_3)
#endif
#if LEVELS > 4
    ADD_LEVEL(4, amplitudes_4)
#endif
#if LEVELS > 5
    ADD_LEVEL(5, amplitudes_5)
#endif
    vec3 colour = texel.rgb + noise_scale * (RGB_FROM_YCBCR * total);
    imageStore(image, pixel, vec4(clamp(colour, 0.0, 1.0), 0.0));
}
