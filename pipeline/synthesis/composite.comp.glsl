#version 430
// Composite: weigh every band's noise, look it up where the background comes from, and add
// it to the base, in hole pixels only, in place.
// Twin: shaped_noise(), look_up() and sample() in reference.py. Change both or neither.

#constant LEVELS
#constant CHANNELS  // of noise: 1 or 3
#constant NOISE_TILE
#constant ANCHOR    // 0: screen, 1: warped motion, 2: depth and two cameras

#include "tiles.glsl"
#include "guided.glsl"

layout(rgba32f, binding = 0) uniform image2D image;  // rgb: encoded colour; a: 1 known, 0 hole
layout(r32f, binding = 1) uniform readonly image2D depth_m;
#if ANCHOR == 1
layout(rg32f, binding = 2) uniform readonly image2D flow_px;  // target minus source
#endif
// Per texel high, along x, along y; w of the first: guide. Level k at resolution k + 1.
layout(std430, binding = 4) readonly buffer Amplitudes { vec4 amplitudes[]; };
// Per texel LEVELS x CHANNELS; rgb: bands.
layout(std430, binding = 5) readonly buffer Noise { vec4 noise[]; };

uniform float z_near_m;
uniform float noise_scale;
uniform ivec3 level_size[LEVELS];          // columns, rows, first texel
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

vec2 anchor(ivec2 pixel, float depth) {
    vec2 here = vec2(pixel) + 0.5;
#if ANCHOR == 1
    return here - imageLoad(flow_px, pixel).rg;
#elif ANCHOR == 2
    vec4 point = source_from_target * vec4(here, 1.0, 1.0 / depth);
    return point.xy / point.z;
#else
    return here;
#endif
}

int noise_texel(ivec2 place) {
    ivec2 wrapped = place & (NOISE_TILE - 1);
    return (wrapped.y * NOISE_TILE + wrapped.x) * LEVELS * CHANNELS;
}

void work(ivec2 pixel) {
    vec4 texel = imageLoad(image, pixel);
    if (texel.a >= 0.5) return;
    float depth = imageLoad(depth_m, pixel).r;
    float guide = max(0.0, 1.0 - z_near_m / depth);

    vec2 noise_place = anchor(pixel, depth) - 0.5;
    ivec2 corner = ivec2(floor(noise_place));
    vec4 w = bilinear(noise_place - vec2(corner));
    bool between = w.x < 1.0;
    int noise_a = noise_texel(corner), noise_b = noise_texel(corner + ivec2(1, 0));
    int noise_c = noise_texel(corner + ivec2(0, 1)), noise_d = noise_texel(corner + 1);
    float self = dot(w, w);
    vec4 lag = 2.0 * vec4(w.x * w.y + w.z * w.w, w.x * w.z + w.y * w.w, w.x * w.w, w.y * w.z);

    vec3 total = vec3(0.0);
    float scale = 0.5;
    for (int level = 0; level < LEVELS; ++level) {
        ivec3 size = level_size[level];
        vec2 place = (vec2(pixel) + 0.5) * scale - 0.5;
        scale *= 0.5;
        vec2 floored = floor(place);
        ivec2 near = clamp(ivec2(floored), ivec2(0), size.xy - 1);
        ivec2 far = clamp(ivec2(floored) + 1, ivec2(0), size.xy - 1);
        int a = 3 * (size.z + near.y * size.x + near.x);
        int b = 3 * (size.z + near.y * size.x + far.x);
        int c = 3 * (size.z + far.y * size.x + near.x);
        int d = 3 * (size.z + far.y * size.x + far.x);
        vec4 high_a = amplitudes[a], high_b = amplitudes[b];
        vec4 high_c = amplitudes[c], high_d = amplitudes[d];
        vec4 share = guided(bilinear(place - floored), guide,
                            vec4(high_a.w, high_b.w, high_c.w, high_d.w));
        vec3 high = mixed(share, high_a, high_b, high_c, high_d).rgb;
        vec3 along_x = mixed(share, amplitudes[a + 1], amplitudes[b + 1], amplitudes[c + 1],
                             amplitudes[d + 1]).rgb;
        vec3 along_y = mixed(share, amplitudes[a + 2], amplitudes[b + 2], amplitudes[c + 2],
                             amplitudes[d + 2]).rgb;
        // Interpolated noise has less variance; see look_up().
        vec3 gain = vec3(1.0);
        if (between) {
            gain = inversesqrt(self + vec3(dot(lag, lag_correlation[3 * level]),
                                           dot(lag, lag_correlation[3 * level + 1]),
                                           dot(lag, lag_correlation[3 * level + 2])));
        }
        for (int channel = 0; channel < CHANNELS; ++channel) {
            int offset = level * CHANNELS + channel;
            vec3 bands = noise[noise_a + offset].rgb;
            if (between) {
                bands = w.x * bands + w.y * noise[noise_b + offset].rgb
                      + w.z * noise[noise_c + offset].rgb + w.w * noise[noise_d + offset].rgb;
            }
            bands *= gain;
            vec3 shaped = bands.x * high + bands.y * along_x + bands.z * along_y;
#if CHANNELS == 1
            total += shaped;
#else
            total += shaped * vec3(equal(ivec3(channel), ivec3(0, 1, 2)));
#endif
        }
    }
    vec3 colour = texel.rgb + noise_scale * (RGB_FROM_YCBCR * total);
    imageStore(image, pixel, vec4(clamp(colour, 0.0, 1.0), 0.0));
}
