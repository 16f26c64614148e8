#version 430
// Composite: weigh every band's noise, look it up where the background comes from, and add
// it to the base, in hole pixels only, in place.
// Twin: shaped_noise(), deviations() and sample() in reference.py, look_up() in noise/tile.py. Change both
// or neither.

#constant LEVELS
#constant CHANNELS  // of noise: 1 or 3
#constant NOISE_TEXELS         // along an edge of the tile
#constant NOISE_TEXELS_PER_PX
#constant MOVES     // 1: noise goes with the motion, 0: lies on the screen
#constant ANCHOR_REACH_PX
#constant FOVEATED  // 1: where the gaze leaves it
#constant SMALLEST_LACKING  // variance that is no more divided by its own root

#include "pixels.glsl"
#include "guided.glsl"
#include "interpolated.glsl"
#include "taps.glsl"
#include "ycbcr.glsl"

layout(rgba32f) uniform image2D image;  // rgb: encoded colour; a: 1 known, 0 hole
layout(r32f) uniform readonly image2D depth_m;
layout(rg32f) uniform readonly image2D flow_px;  // target minus source
// Variance of the noise to add. Per texel high, along x, along y; w of the first: guide.
// Level k at resolution k + 1.
layout(rgba32f) uniform readonly image2D variances;
// LEVELS x CHANNELS neighbours per texel; rgb: bands.
layout(rgba32f) uniform readonly image2D noise;

#if FOVEATED
layout(r32f) uniform readonly image2D attention;  // share of the noise
#endif

uniform float z_near_m;
uniform float noise_scale;
uniform ivec4 level_size[LEVELS];          // columns, rows, where its first texel lies
uniform vec4 lag_correlation[LEVELS * 3];  // lags (0, 1), (1, 0), (1, 1), (1, -1)

vec2 anchor(ivec2 pixel) {
    vec2 here = vec2(pixel) + 0.5;
    vec2 place = MOVES == 1 ? here - imageLoad(flow_px, pixel).rg : here;
    return all(lessThan(abs(place), vec2(ANCHOR_REACH_PX))) ? place : here;
}

ivec2 noise_texel(ivec2 place) {
    return (place & (NOISE_TEXELS - 1)) * ivec2(LEVELS * CHANNELS, 1);
}

// A pixel and where its noise comes from. One that is no hole, or outside of the frame, is carried
// along until it is time to store: drivers run both sides of a branch anyway.
struct Pixel {
    ivec2 place;
    bool hole;
    float guide;
    vec3 colour;
    ivec2 noise_corner;
    vec4 noise_share;
    vec3 noise;  // the sum so far: Y', Cb, Cr
};

Pixel pixel_at(ivec2 place) {
    Pixel p;
    p.place = place;
    p.noise = vec3(0.0);
    vec4 texel = imageLoad(image, place);
    p.hole = texel.a < 0.5 && all(lessThan(place, imageSize(image)));
    p.colour = texel.rgb;
    float depth = imageLoad(depth_m, place).r;
    p.guide = max(0.0, 1.0 - z_near_m / depth);
    vec2 noise_place = float(NOISE_TEXELS_PER_PX) * (anchor(place) - 0.5);
    p.noise_corner = ivec2(floor(noise_place));
    p.noise_share = bilinear(noise_place - floor(noise_place));
    return p;
}

// One level's noise of all bands at a pixel; interpolated noise has less variance, which
// the gain restores. See look_up().
vec3 noise_bands(Pixel p, int level, int channel) {
    ivec2 next = ivec2(level * CHANNELS + channel, 0);
    vec4 w = p.noise_share;
    vec3 bands = w.x * imageLoad(noise, noise_texel(p.noise_corner) + next).rgb
               + w.y * imageLoad(noise, noise_texel(p.noise_corner + ivec2(1, 0)) + next).rgb
               + w.z * imageLoad(noise, noise_texel(p.noise_corner + ivec2(0, 1)) + next).rgb
               + w.w * imageLoad(noise, noise_texel(p.noise_corner + 1) + next).rgb;
    vec3 variance;
    for (int band = 0; band < 3; ++band) variance[band] = kept_variance(w, lag_correlation[3 * level + band]);
    return bands * inversesqrt(variance);
}

// Variances of one texel.
struct Texel {
    float guide;
    vec3 high, along_x, along_y;
};

Texel variances_at(ivec2 place, ivec4 size) {
    place = clamp(place, ivec2(0), size.xy - 1);
    ivec2 at = ivec2(3 * place.x, place.y) + size.zw;
    vec4 high = imageLoad(variances, at);
    vec3 along_x = imageLoad(variances, at + ivec2(1, 0)).rgb;
    vec3 along_y = imageLoad(variances, at + ivec2(2, 0)).rgb;
    return Texel(high.w, high.rgb, along_x, along_y);
}

// Variances are interpolated before their root is taken. See deviations().
vec3 deviation(vec3 variance) {
    return CHANNELS == 1 ? variance * inversesqrt(max(variance.x, SMALLEST_LACKING)) : sqrt(variance);
}

#define MIXED(name) (share.x * a.name + share.y * b.name + share.z * c.name + share.w * d.name)

void add_level(inout Pixel p, int level, vec4 share, Texel a, Texel b, Texel c, Texel d) {
    vec4 guides = vec4(a.guide, b.guide, c.guide, d.guide);
    share = guided_shares(share, p.guide, guides).share;
    vec3 high = deviation(MIXED(high));
    vec3 along_x = deviation(MIXED(along_x)), along_y = deviation(MIXED(along_y));
    vec3 bands = noise_bands(p, level, 0);
    if (CHANNELS == 1) {
        p.noise += bands.x * high + bands.y * along_x + bands.z * along_y;
        return;
    }
    vec3 blue = noise_bands(p, level, 1), red = noise_bands(p, level, 2);
    p.noise += vec3(bands.x, blue.x, red.x) * high
             + vec3(bands.y, blue.y, red.y) * along_x
             + vec3(bands.z, blue.z, red.z) * along_y;
}

void finish(Pixel p) {
    if (!p.hole) return;
    float scale = noise_scale;
#if FOVEATED
    scale *= imageLoad(attention, p.place).r;
#endif
    vec3 colour = p.colour + scale * (RGB_FROM_YCBCR * p.noise);
    imageStore(image, p.place, vec4(clamp(colour, 0.0, 1.0), 0.0));
}

// `parent` is a pixel of resolution 1; its four children share most of what they read.
void work(ivec2 parent, int chain) {
    Pixel p00 = pixel_at(2 * parent), p01 = pixel_at(2 * parent + ivec2(1, 0));
    Pixel p10 = pixel_at(2 * parent + ivec2(0, 1)), p11 = pixel_at(2 * parent + 1);

    // Level 0: 3x3 texels around the parent, each child between the four on its side.
    {
        ivec4 size = level_size[0];
        Texel t00 = variances_at(parent - 1, size), t02 = variances_at(parent + ivec2(1, -1), size);
        Texel t01 = variances_at(parent + ivec2(0, -1), size);
        Texel t10 = variances_at(parent + ivec2(-1, 0), size);
        Texel t11 = variances_at(parent, size), t12 = variances_at(parent + ivec2(1, 0), size);
        Texel t20 = variances_at(parent + ivec2(-1, 1), size);
        Texel t21 = variances_at(parent + ivec2(0, 1), size), t22 = variances_at(parent + 1, size);
        add_level(p00, 0, bilinear(vec2(0.75, 0.75)), t00, t01, t10, t11);
        add_level(p01, 0, bilinear(vec2(0.25, 0.75)), t01, t02, t11, t12);
        add_level(p10, 0, bilinear(vec2(0.75, 0.25)), t10, t11, t20, t21);
        add_level(p11, 0, bilinear(vec2(0.25, 0.25)), t11, t12, t21, t22);
    }
    // Coarser levels: all four children lie between the same four texels.
    float scale = 0.25;
    for (int level = 1; level < LEVELS; ++level, scale *= 0.5) {
        ivec4 size = level_size[level];
        vec2 first = (vec2(2 * parent) + 0.5) * scale - 0.5;
        ivec2 corner = ivec2(floor(first));
        vec2 near = first - floor(first), far = near + scale;
        Texel a = variances_at(corner, size), b = variances_at(corner + ivec2(1, 0), size);
        Texel c = variances_at(corner + ivec2(0, 1), size), d = variances_at(corner + 1, size);
        add_level(p00, level, bilinear(near), a, b, c, d);
        add_level(p01, level, bilinear(vec2(far.x, near.y)), a, b, c, d);
        add_level(p10, level, bilinear(vec2(near.x, far.y)), a, b, c, d);
        add_level(p11, level, bilinear(far), a, b, c, d);
    }
    finish(p00);
    finish(p01);
    finish(p10);
    finish(p11);
}
