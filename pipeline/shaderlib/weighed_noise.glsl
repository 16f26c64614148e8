// Noise on a base, for 2x2 pixels, which share what weighs their finer levels' noise: weighed, faded in beyond the fovea and kept on the display; the fovea is copied.
// Twin: metamer_parts() and finished() in foveation/reference.py. Change both or neither.
// Whoever includes this gives the noise: see add_noise().

#constant LEVELS
#constant BASE                // 1: the base is the last push's; 0: it is the source
#constant BENT                // 1: the pool's colours have a shape
#constant NOISE_SCALE         // deviations of a step of the noise
#constant COLOURED            // chroma's variance over luma's from which on noise keeps to them
#constant ROOMY               // room for noise over its pool's
#constant FIRST_SMOOTH        // level from which on every pixel has weights of its own

#include "pools.glsl"
#include "fade.glsl"
#include "bounded.glsl"
#include "ycbcr.glsl"
#include "sphere.glsl"

uniform sampler2D source;
layout(rgba32f) uniform writeonly image2D target;
#if BASE
uniform sampler2D coarse;  // chosen, linear
#endif
// By blocks, linear. A layer a level: weights of high, along x, along y; a: Cb that goes with luma.
// Then, four a layer: Cr of the levels, the deviation of luma, the shape of the pool's colours.
uniform sampler2DArray weights;
uniform float strength;    // of the noise

const int SCALARS = LEVELS + 1 + 4 * BENT, SCALAR_LAYERS = (SCALARS + 3) / 4;

// Of four pixels.
struct Noise { vec4 luma, blue, red; };

vec3 rgb_of(Noise noise, int i) { return RGB_FROM_YCBCR * vec3(noise.luma[i], noise.blue[i], noise.red[i]); }

// Hold noise to the colours of its pool. Twin: reach_of() in foveation/reference.py.
Spread held(Spread spread, vec3 skew, float tightness, float coloured) {
    vec3 lean = 1.5 * skew * (1.0 + tightness), total = abs(lean) + sqrt(lean * lean + tightness);
    vec3 scale = spread.deviation * max(ROOMY, COLOURED / max(coloured, SMALLEST_VARIANCE));
    vec3 near = scale / total, far = scale * total / tightness;
    spread.below = where_against(lean, far, near);
    spread.above = where_against(lean, near, far);
    spread.along *= alike(spread);
    return spread;
}

// Shares of the four blocks around a cell, as textureGather() has them, in each of its pixels: a
// column a pixel.
mat4 shares_of(ivec2 cell) {
    vec2 place = vec2(0.75) - 0.5 * vec2(cell & 1);  // of the cell's middle between blocks
    mat4 shares;
    for (int i = 0; i < 4; ++i) {
        vec2 next = place + 0.125 * (2.0 * vec2(i & 1, i >> 1) - 1.0), own = 1.0 - next;
        shares[i] = vec4(own.x * next.y, next.x * next.y, next.x * own.y, own.x * own.y);
    }
    return shares;
}

void store(ivec2 pixel, vec3 noise, Spread spread) {
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
#if PROJECTION
    float by = noise_strength(seen.ray);
    noise *= by;
    spread.deviation *= by;
    spread.rate /= by;
#endif
    vec3 changed = added(base, noise, spread);
    imageStore(target, pixel, vec4(faded(own.rgb, changed, seen), own.a));
}

// Add noise to the 2x2 pixels of a cell: of each level, three bands in steps of noise, a column a band.
void add_noise(ivec2 cell, mat3x4 noise[LEVELS]) {
    vec2 at = 0.5 * (vec2(cell) + 0.5) / vec2(textureSize(weights, 0).xy);
    float scalars[4 * SCALAR_LAYERS];
    for (int layer = 0; layer < SCALAR_LAYERS; ++layer) {
        vec4 four = textureLod(weights, vec3(at, float(LEVELS + layer)), 0.0);
        for (int i = 0; i < 4; ++i) scalars[4 * layer + i] = four[i];
    }
    mat4 shares = shares_of(cell);
    Noise sum = Noise(vec4(0.0), vec4(0.0), vec4(0.0));
    vec3 cross_luma = vec3(0.0);
    vec4 varies = vec4(0.0);  // variances of R'G'B' and luma, but for bands' overlap
    float variance = 0.0;     // of chroma
    for (int level = 0; level < LEVELS; ++level) {
        vec4 weight = textureLod(weights, vec3(at, float(level)), 0.0);
        vec4 luma = vec4(0.0);
        if (level < FIRST_SMOOTH) luma = noise[level] * weight.xyz;
        else {
            vec3 layer = vec3(at, float(level));
            luma += textureGather(weights, layer, 0) * shares * noise[level][0];
            luma += textureGather(weights, layer, 1) * shares * noise[level][1];
            luma += textureGather(weights, layer, 2) * shares * noise[level][2];
        }
        vec2 slope = vec2(weight.a, scalars[level]);
        sum.luma += luma;
        sum.blue += slope.x * luma;
        sum.red += slope.y * luma;
        vec3 along = RGB_FROM_YCBCR * vec3(1.0, slope);
        float square = dot(weight.xyz, weight.xyz);
        variance += square * dot(slope, slope);
        varies += square * vec4(along * along, 1.0);
        cross_luma += square * along;
    }
    float by = strength * scalars[LEVELS];
    vec3 parts = varies.a > 0.0 ? varies.rgb / varies.a : vec3(0.0);
    Spread spread = spread_of(by * by * parts, cross_luma, varies);
#if BENT
    vec3 skew = vec3(scalars[LEVELS + 1], scalars[LEVELS + 2], scalars[LEVELS + 3]);
    spread = held(spread, skew, scalars[LEVELS + 4], variance / max(varies.a, SMALLEST_VARIANCE));
#endif
    for (int i = 0; i < 4; ++i)
        store(2 * cell + ivec2(i & 1, i >> 1), NOISE_SCALE * strength * rgb_of(sum, i), spread);
}
