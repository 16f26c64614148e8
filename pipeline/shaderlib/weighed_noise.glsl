// Noise on a base, for 2x2 pixels, which share what weighs their finer levels' noise: weighed, bent,
// faded in beyond the fovea and kept on the display; the fovea is copied.
// Twin: metamer_parts() and finished() in foveation/reference.py. Change both or neither.
// Whoever includes this gives the noise: see add_noise().

#constant LEVELS
#constant BASE                // 1: the base is the last push's; 0: it is the source
#constant BENT                // 1: Cb and Cr have a shape
#constant MOST_BEND           // of noise of unit variance
#constant FIRST_SMOOTH        // level from which on every pixel has weights of its own

#include "pools.glsl"
#include "fade.glsl"
#include "bounded.glsl"
#include "sphere.glsl"

uniform sampler2D source;
layout(rgba32f) uniform writeonly image2D target;
#if BASE
uniform sampler2D coarse;  // chosen, linear
#endif
// By blocks, linear. A layer a level: weights of high, along x, along y; a: Cb that goes with luma.
// Then, four a layer: Cr of the levels, the deviation of luma, the shape of Cb and Cr's noise.
uniform sampler2DArray weights;
uniform float strength;    // of the noise

const int SCALARS = LEVELS + 1 + 3 * BENT, SCALAR_LAYERS = (SCALARS + 3) / 4;

// Of four pixels.
struct Noise { vec4 luma, blue, red; };

// Twin: bent() in reference.py.
vec4 bent(vec4 chroma, float skewness, float tightness, float variance) {
    float deviation = sqrt(variance + SMALLEST_VARIANCE), bend = clamp(skewness, -MOST_BEND, MOST_BEND);
    vec4 turned = (bend / deviation) * chroma;
    // Held where it would turn back.
    vec4 bowed = mix(vec4(-0.25 * deviation / bend), chroma * (1.0 + turned), greaterThan(turned, vec4(-0.5)));
    bowed = (bowed - bend * deviation) * inversesqrt(1.0 + 2.0 * bend * bend);
    float lean = 1.5 * skewness * (1.0 + tightness), root = sqrt(lean * lean + tightness);
    // Its ends, without the difference of lean and root, which may be nothing but rounding.
    float sum = abs(lean) + root, near = deviation / sum, far = deviation * sum / tightness;
    return lean < 0.0 ? clamp(bowed, -far, near) : clamp(bowed, -near, far);
}

// A band of each pixel, weighed: `bands` has a column a pixel.
vec4 weighed(mat4x3 bands, int level, vec2 at, vec3 weight) {
    if (level < FIRST_SMOOTH) return weight * bands;
    vec2 half_px = 0.125 / vec2(textureSize(weights, 0).xy);
    vec4 found;
    for (int i = 0; i < 4; ++i) {
        vec2 aside = half_px * (2.0 * vec2(i & 1, i >> 1) - 1.0);
        found[i] = dot(textureLod(weights, vec3(at + aside, float(level)), 0.0).xyz, bands[i]);
    }
    return found;
}

void store(ivec2 pixel, vec3 noise, float deviation) {
    ivec2 size = textureSize(source, 0);
    if (any(greaterThanEqual(pixel, size))) return;
    vec4 own = texelFetch(source, pixel, 0);
    vec2 place = vec2(pixel) + 0.5;
    Place seen = seen_at(place);
    vec3 base = own.rgb;
#if BASE
    vec2 within = 0.5 * place / vec2((size + 1) / 2);
    base = mix(own.rgb, textureLod(coarse, within, 0.0).rgb, beyond_lod(pool_at(seen), 0));
#endif
    float by = strength;
#if PROJECTION
    by *= noise_strength(seen.ray);
#endif
    vec3 changed = added(base, by * noise, by * deviation);
    imageStore(target, pixel, vec4(faded(own.rgb, changed, seen), own.a));
}

// Add noise to the 2x2 pixels of a cell: of each level, unit noise in three bands of each pixel.
void add_noise(ivec2 cell, mat4x3 noise[LEVELS]) {
    vec2 at = 0.5 * (vec2(cell) + 0.5) / vec2(textureSize(weights, 0).xy);
    float scalars[4 * SCALAR_LAYERS];
    for (int layer = 0; layer < SCALAR_LAYERS; ++layer) {
        vec4 four = textureLod(weights, vec3(at, float(LEVELS + layer)), 0.0);
        for (int i = 0; i < 4; ++i) scalars[4 * layer + i] = four[i];
    }
    Noise sum = Noise(vec4(0.0), vec4(0.0), vec4(0.0));
    vec2 variance = vec2(0.0);  // of Cb and Cr
    for (int level = 0; level < LEVELS; ++level) {
        vec4 weight = textureLod(weights, vec3(at, float(level)), 0.0);
        vec4 luma = weighed(noise[level], level, at, weight.xyz);
        vec2 slope = vec2(weight.a, scalars[level]);
        sum.luma += luma;
        sum.blue += slope.x * luma;
        sum.red += slope.y * luma;
        variance += dot(weight.xyz, weight.xyz) * slope * slope;
    }
#if BENT
    float tightness = scalars[LEVELS + 3];
    sum.blue = bent(sum.blue, scalars[LEVELS + 1], tightness, variance.x);
    sum.red = bent(sum.red, scalars[LEVELS + 2], tightness, variance.y);
#endif
    for (int i = 0; i < 4; ++i)
        store(2 * cell + ivec2(i & 1, i >> 1), vec3(sum.luma[i], sum.blue[i], sum.red[i]), scalars[LEVELS]);
}
