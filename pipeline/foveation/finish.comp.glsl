#version 430
// Finish: the last push, noise on top of it, faded in beyond the fovea and clipped; the fovea is
// copied. A call makes 2x2 pixels, which share what weighs their noise.
// Twin: shaped_noise() and finished() in reference.py. Change both or neither.

#constant TILE        // work-group edge, 2x2 pixels
#constant FADE_SHARE  // of the fovea's radius: over it what is changed fades in
#constant NOISE       // 1: add noise; 0: the blur of equal pooling
#constant BASE        // 1: the picture is pooled at all

#include "pools.glsl"
#if NOISE
#include "ycbcr.glsl"
#endif

layout(local_size_x = TILE, local_size_y = TILE) in;

layout(binding = 0) uniform sampler2D source;
layout(rgba32f, binding = 0) uniform writeonly image2D target;
#if BASE
layout(binding = 1) uniform sampler2D coarse;  // chosen, linear
#endif

#if NOISE
#constant LEVELS
#constant CARRIED          // 1: noise is looked up where the surface was; 0: it lies on the screen
layout(binding = 2) uniform sampler2DArray weights;  // by blocks, linear; see gains.comp.glsl
layout(binding = 3) uniform sampler2DArray noise;    // a layer a level: high, along x, along y
uniform float noise_scale;
#if CARRIED
#constant TEXELS_PER_PX
layout(binding = 4) uniform sampler2D shift_px;
uniform vec4 lag_correlation[LEVELS * 3];  // lags (0, 1), (1, 0), (1, 1), (1, -1)
#endif

vec3 noise_at(ivec2 texel, int level) {
    ivec2 size = textureSize(noise, 0).xy;
    texel = texel % size;
    texel += size * ivec2(lessThan(texel, ivec2(0)));
    return texelFetch(noise, ivec3(texel, level), 0).rgb;
}

#if CARRIED
// Where a pixel's noise lies, and how much each of four texels there counts.
struct Spot { ivec2 corner; vec4 share, lag; };

Spot spot_of(ivec2 pixel) {
    vec2 at = float(TEXELS_PER_PX) * (vec2(pixel) - texelFetch(shift_px, pixel, 0).rg);
    vec2 part = at - floor(at), rest = 1.0 - part;
    vec4 w = vec4(rest.x * rest.y, part.x * rest.y, rest.x * part.y, part.x * part.y);
    vec4 lag = 2.0 * vec4(w.x * w.y + w.z * w.w, w.x * w.z + w.y * w.w, w.x * w.w, w.y * w.z);
    return Spot(ivec2(floor(at)), w, lag);
}

// Interpolated noise has less variance, which is given back. See look_up() in synthesis/.
vec3 noise_of(Spot spot, int level) {
    vec4 w = spot.share;
    vec3 bands = w.x * noise_at(spot.corner, level) + w.y * noise_at(spot.corner + ivec2(1, 0), level)
               + w.z * noise_at(spot.corner + ivec2(0, 1), level) + w.w * noise_at(spot.corner + 1, level);
    vec3 variance = dot(w, w) + vec3(dot(spot.lag, lag_correlation[3 * level]),
                                     dot(spot.lag, lag_correlation[3 * level + 1]),
                                     dot(spot.lag, lag_correlation[3 * level + 2]));
    return bands * inversesqrt(variance);
}
#else
#define Spot ivec2
ivec2 spot_of(ivec2 pixel) { return pixel; }
vec3 noise_of(ivec2 pixel, int level) { return noise_at(pixel, level); }
#endif
#endif

void store(ivec2 pixel, ivec2 size, vec3 change) {
    if (any(greaterThanEqual(pixel, size))) return;
    vec4 own = texelFetch(source, pixel, 0);
    vec2 place = vec2(pixel) + 0.5;
    Place seen = seen_at(place);
    float away = seen.eccentricity_deg - fovea_deg;
    float fade = fovea_deg > 0.0 ? clamp(away / (FADE_SHARE * fovea_deg), 0.0, 1.0) : float(away > 0.0);
    vec3 changed = own.rgb;
#if BASE
    vec2 within = 0.5 * place / vec2((size + 1) / 2);
    changed = mix(own.rgb, textureLod(coarse, within, 0.0).rgb, beyond_lod(pool_at(seen), 0));
#endif
    vec3 result = clamp(own.rgb + fade * (changed + change - own.rgb), 0.0, 1.0);
    imageStore(target, pixel, vec4(fade > 0.0 ? result : own.rgb, own.a));
}

void main() {
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy), first = 2 * cell;
    ivec2 size = textureSize(source, 0);
    if (any(greaterThanEqual(first, size))) return;
#if NOISE
    vec3 a = vec3(0.0), b = vec3(0.0), c = vec3(0.0), d = vec3(0.0);
    vec2 at = 0.5 * (vec2(cell) + 0.5) / vec2(textureSize(weights, 0).xy);
    vec4 red[(LEVELS + 3) / 4];
    for (int i = 0; i < (LEVELS + 3) / 4; ++i) red[i] = textureLod(weights, vec3(at, float(LEVELS + i)), 0.0);
    Spot at_a = spot_of(first), at_b = spot_of(first + ivec2(1, 0));
    Spot at_c = spot_of(first + ivec2(0, 1)), at_d = spot_of(first + 1);
    for (int level = 0; level < LEVELS; ++level) {
        vec4 w = textureLod(weights, vec3(at, float(level)), 0.0);
        vec3 ycc = vec3(1.0, w.a, red[level / 4][level % 4]);
        a += dot(w.xyz, noise_of(at_a, level)) * ycc;
        b += dot(w.xyz, noise_of(at_b, level)) * ycc;
        c += dot(w.xyz, noise_of(at_c, level)) * ycc;
        d += dot(w.xyz, noise_of(at_d, level)) * ycc;
    }
    mat3 colour = noise_scale * RGB_FROM_YCBCR;
    store(first, size, colour * a);
    store(first + ivec2(1, 0), size, colour * b);
    store(first + ivec2(0, 1), size, colour * c);
    store(first + 1, size, colour * d);
#else
    store(first, size, vec3(0.0));
    store(first + ivec2(1, 0), size, vec3(0.0));
    store(first + ivec2(0, 1), size, vec3(0.0));
    store(first + 1, size, vec3(0.0));
#endif
}
