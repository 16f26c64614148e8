#version 430
// Finish: the last push, noise on top of it, faded in beyond the fovea and clipped; the fovea is
// copied. A call makes 2x2 pixels, which share what weighs their finer levels' noise.
// Twin: shaped_noise() and finished() in reference.py. Change both or neither.

#constant TILE        // work-group edge, 2x2 pixels
#constant NOISE       // 1: add noise; 0: the blur of equal pooling
#constant BASE        // 1: the picture is pooled at all

#include "pools.glsl"
#include "fade.glsl"
#if NOISE
#include "ycbcr.glsl"
#include "sphere.glsl"
#endif

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform sampler2D source;
layout(rgba32f) uniform writeonly image2D target;
#if BASE
uniform sampler2D coarse;  // chosen, linear
#endif

#if NOISE
#constant LEVELS
#constant BENT             // 1: Cb and Cr have a shape
#constant MOST_BEND        // of noise of unit variance
#constant SMALLEST_VARIANCE  // added to chroma's
#constant CARRIED          // 1: noise is looked up where the surface was; 0: it lies on the screen
uniform sampler2DArray weights;  // by blocks, linear; see gains.comp.glsl
// Signed bytes, four a word; bands level by level, high, along x, along y. On the screen a word is a
// band of 2x2 pixels, four bands a layer. Carried, a texel is a place, sixteen bands a layer.
uniform usampler2DArray noise;
uniform float noise_scale;
#if CARRIED
#constant TEXELS_PER_PX
uniform sampler2D shift_px;
uniform vec4 lag_correlation[LEVELS * 3];  // lags (0, 1), (1, 0), (1, 1), (1, -1)
#endif

#constant NOISE_ROWS     // of texels: a power of two, or so many that no pixel lies beyond
#constant NOISE_COLUMNS
#constant NOISE_SCALE    // of a step

// A word's bytes.
vec4 steps_of(uint word) { return vec4(ivec4(word << 24, word << 16, word << 8, word) >> 24); }

// Within the noise, which goes on at its borders.
ivec2 wrapped(ivec2 texel) {
    return texel & ivec2((NOISE_COLUMNS & (NOISE_COLUMNS - 1)) == 0 ? NOISE_COLUMNS - 1 : -1,
                         (NOISE_ROWS & (NOISE_ROWS - 1)) == 0 ? NOISE_ROWS - 1 : -1);
}

#if BENT
#define SLOT(i) ((i) < 4 ? red[(i) % 4] : more_red[(i) % 4])
// Twin: bent() in reference.py.
vec4 bent(vec4 chroma, float skewness, float tightness, float variance) {
    float deviation = sqrt(variance + SMALLEST_VARIANCE), bend = clamp(skewness, -MOST_BEND, MOST_BEND);
    vec4 turned = (bend / deviation) * chroma;
    // Held where it would turn back.
    vec4 bowed = mix(vec4(-0.25 * deviation / bend), chroma * (1.0 + turned), greaterThan(turned, vec4(-0.5)));
    bowed = (bowed - bend * deviation) * inversesqrt(1.0 + 2.0 * bend * bend);
    float lean = 1.5 * skewness * (1.0 + tightness), root = sqrt(lean * lean + tightness);
    float reach = deviation / tightness;
    return clamp(bowed, reach * (lean - root), reach * (lean + root));
}
#endif

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

const int PLACE_LAYERS = (3 * LEVELS + 15) / 16, PLACE_WORDS = 4 * PLACE_LAYERS;

// The bands of a pixel, four a vector, not yet of unit variance.
struct Carried { vec4 of[PLACE_WORDS]; };

Carried carried_at(Spot spot) {
    Carried bands;
    ivec2 a = wrapped(spot.corner), d = wrapped(spot.corner + 1);
    for (int layer = 0; layer < PLACE_LAYERS; ++layer) {
        uvec4 at_a = texelFetch(noise, ivec3(a, layer), 0);
        uvec4 at_b = texelFetch(noise, ivec3(d.x, a.y, layer), 0);
        uvec4 at_c = texelFetch(noise, ivec3(a.x, d.y, layer), 0);
        uvec4 at_d = texelFetch(noise, ivec3(d, layer), 0);
        for (int word = 0; word < 4; ++word)
            bands.of[4 * layer + word] =
                spot.share.x * steps_of(at_a[word]) + spot.share.y * steps_of(at_b[word])
              + spot.share.z * steps_of(at_c[word]) + spot.share.w * steps_of(at_d[word]);
    }
    return bands;
}

// Interpolated noise has less variance, which is given back. See look_up() in synthesis/.
#define CARRIED_BAND(bands, spot, band)                                  \
    (bands.of[(band) / 4][(band) % 4]                                    \
     * inversesqrt(dot(spot.share, spot.share) + dot(spot.lag, lag_correlation[band])))
#define CARRIED_NOISE(bands, spot, level)                                \
    vec3(CARRIED_BAND(bands, spot, 3 * level), CARRIED_BAND(bands, spot, 3 * level + 1), \
         CARRIED_BAND(bands, spot, 3 * level + 2))
#endif
#endif

void store(ivec2 pixel, ivec2 size, vec3 change) {
    if (any(greaterThanEqual(pixel, size))) return;
    vec4 own = texelFetch(source, pixel, 0);
    vec2 place = vec2(pixel) + 0.5;
    Place seen = seen_at(place);
    vec3 changed = own.rgb;
#if NOISE && PROJECTION
    change *= noise_strength(seen.ray);
#endif
#if BASE
    vec2 within = 0.5 * place / vec2((size + 1) / 2);
    changed = mix(own.rgb, textureLod(coarse, within, 0.0).rgb, beyond_lod(pool_at(seen), 0));
#endif
    imageStore(target, pixel, vec4(faded(own.rgb, changed + change, seen), own.a));
}

void main() {
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy), first = 2 * cell;
    ivec2 size = textureSize(source, 0);
    if (any(greaterThanEqual(first, size))) return;
#if NOISE
    vec4 luma = vec4(0.0), blue_chroma = vec4(0.0), red_chroma = vec4(0.0);  // of 2x2 pixels
    vec2 blocks = vec2(textureSize(weights, 0).xy);
    vec2 at = 0.5 * (vec2(cell) + 0.5) / blocks, half_px = vec2(0.125) / blocks;
    vec4 red = textureLod(weights, vec3(at, float(LEVELS)), 0.0);
    vec4 more_red = vec4(0.0);
#if LEVELS + 3 * BENT > 4
    more_red = textureLod(weights, vec3(at, float(LEVELS + 1)), 0.0);
#endif
#if LEVELS + 3 * BENT > 8
    float tightness = textureLod(weights, vec3(at, float(LEVELS + 2)), 0.0).x;
#elif BENT
    float tightness = SLOT(LEVELS + 2);
#endif
#if CARRIED
    Spot at_a = spot_of(first), at_b = spot_of(first + ivec2(1, 0));
    Spot at_c = spot_of(first + ivec2(0, 1)), at_d = spot_of(first + 1);
    Carried in_a = carried_at(at_a), in_b = carried_at(at_b);
    Carried in_c = carried_at(at_c), in_d = carried_at(at_d);
#define NOISE_OF(level)                                                               \
    mat4x3(CARRIED_NOISE(in_a, at_a, level), CARRIED_NOISE(in_b, at_b, level),        \
           CARRIED_NOISE(in_c, at_c, level), CARRIED_NOISE(in_d, at_d, level))
#else
    ivec2 place = wrapped(cell);
    uvec4 words[(3 * LEVELS + 3) / 4];
    for (int layer = 0; layer < words.length(); ++layer)
        words[layer] = texelFetch(noise, ivec3(place, layer), 0);
#define BAND(band) steps_of(words[(band) / 4][(band) % 4])
#define NOISE_OF(level) transpose(mat3x4(BAND(3 * level), BAND(3 * level + 1), BAND(3 * level + 2)))
#endif
#if BENT
    float blue_variance = 0.0, red_variance = 0.0;
#define ADD_VARIANCE(w, slope)                                     \
    {                                                              \
        float variance = dot(w.xyz, w.xyz);                        \
        blue_variance += variance * w.a * w.a;                     \
        red_variance += variance * (slope) * (slope);              \
    }
#else
#define ADD_VARIANCE(w, slope)
#endif
#define ADD_SHAPED(slope)                                            \
        luma += shaped;                                              \
        blue_chroma += w.a * shaped;                                 \
        red_chroma += (slope) * shaped;                              \
        ADD_VARIANCE(w, slope)
#define ADD_LEVEL(level, slope)                                      \
    {                                                                \
        vec4 w = textureLod(weights, vec3(at, float(level)), 0.0);   \
        vec4 shaped = w.xyz * NOISE_OF(level);                       \
        ADD_SHAPED(slope)                                            \
    }
    // Weights are linear within 2x2 pixels: what these share is their mean.
#define ADD_SMOOTH_LEVEL(level, slope)                                                      \
    {                                                                                       \
        vec4 w_a = textureLod(weights, vec3(at - half_px, float(level)), 0.0);              \
        vec4 w_b = textureLod(weights, vec3(at + vec2(half_px.x, -half_px.y), float(level)), 0.0); \
        vec4 w_c = textureLod(weights, vec3(at + vec2(-half_px.x, half_px.y), float(level)), 0.0); \
        vec4 w_d = textureLod(weights, vec3(at + half_px, float(level)), 0.0);              \
        vec4 w = 0.25 * (w_a + w_b + w_c + w_d);                                            \
        mat4x3 own = NOISE_OF(level);                                                       \
        vec4 shaped = vec4(dot(w_a.xyz, own[0]), dot(w_b.xyz, own[1]),                      \
                           dot(w_c.xyz, own[2]), dot(w_d.xyz, own[3]));                     \
        ADD_SHAPED(slope)                                                                   \
    }
    ADD_LEVEL(0, red.x)
#if LEVELS > 1
    ADD_LEVEL(1, red.y)
#endif
#if LEVELS > 2
    ADD_LEVEL(2, red.z)
#endif
#if LEVELS > 3
    ADD_SMOOTH_LEVEL(3, red.w)
#endif
#if LEVELS > 4
    ADD_SMOOTH_LEVEL(4, more_red.x)
#endif
#if LEVELS > 5
    ADD_SMOOTH_LEVEL(5, more_red.y)
#endif
    luma *= NOISE_SCALE;
    blue_chroma *= NOISE_SCALE;
    red_chroma *= NOISE_SCALE;
#if BENT
    blue_chroma = bent(blue_chroma, SLOT(LEVELS), tightness, blue_variance);
    red_chroma = bent(red_chroma, SLOT(LEVELS + 1), tightness, red_variance);
#endif
    mat3 colour = noise_scale * RGB_FROM_YCBCR;
    store(first, size, colour * vec3(luma.x, blue_chroma.x, red_chroma.x));
    store(first + ivec2(1, 0), size, colour * vec3(luma.y, blue_chroma.y, red_chroma.y));
    store(first + ivec2(0, 1), size, colour * vec3(luma.z, blue_chroma.z, red_chroma.z));
    store(first + 1, size, colour * vec3(luma.w, blue_chroma.w, red_chroma.w));
#else
    store(first, size, vec3(0.0));
    store(first + ivec2(1, 0), size, vec3(0.0));
    store(first + ivec2(0, 1), size, vec3(0.0));
    store(first + 1, size, vec3(0.0));
#endif
}
