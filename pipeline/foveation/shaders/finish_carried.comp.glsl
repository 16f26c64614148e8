#version 430
// Finish with noise that surfaces have carried along: see weighed_noise.glsl. A call makes 2x2 pixels.
// Twin: look_up() in noise/tile.py. Change both or neither.

#constant TILE         // work-group edge, 2x2 pixels
#constant TEXELS_PER_PX

#include "weighed_noise.glsl"
#include "interpolated.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

// A texel is a place: bands level by level, signed bytes, sixteen a layer. It goes on at its borders,
// and its edge is a power of two.
uniform usampler2DArray noise;
uniform sampler2D shift_px;
uniform vec4 lag_correlation[LEVELS * 3];  // lags (0, 1), (1, 0), (1, 1), (1, -1)

const int LAYERS = (3 * LEVELS + 15) / 16, WORDS = 4 * LAYERS;

vec4 four_bands(uint word) {
    return vec4(ivec4(word << 24, word << 16, word << 8, word) >> 24);
}

// The bands of a pixel, four a vector, of unit variance.
struct Bands { vec4 of[WORDS]; };

Bands bands_at(ivec2 pixel) {
    vec2 at = float(TEXELS_PER_PX) * (vec2(pixel) - texelFetch(shift_px, pixel, 0).rg);
    ivec2 last = textureSize(noise, 0).xy - 1, a = ivec2(floor(at)) & last, d = (a + 1) & last;
    vec4 share = bilinear(at - floor(at));
    Bands bands;
    for (int layer = 0; layer < LAYERS; ++layer) {
        uvec4 at_a = texelFetch(noise, ivec3(a, layer), 0);
        uvec4 at_b = texelFetch(noise, ivec3(d.x, a.y, layer), 0);
        uvec4 at_c = texelFetch(noise, ivec3(a.x, d.y, layer), 0);
        uvec4 at_d = texelFetch(noise, ivec3(d, layer), 0);
        for (int i = 0; i < 4; ++i)
            bands.of[4 * layer + i] = share.x * four_bands(at_a[i]) + share.y * four_bands(at_b[i])
                                    + share.z * four_bands(at_c[i]) + share.w * four_bands(at_d[i]);
    }
    // Interpolated noise has less variance, which is given back.
    for (int band = 0; band < 3 * LEVELS; ++band)
        bands.of[band / 4][band % 4] *= inversesqrt(kept_variance(share, lag_correlation[band]));
    return bands;
}

void main() {
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy), first = 2 * cell;
    if (any(greaterThanEqual(first, textureSize(source, 0)))) return;
    mat3x4 bands[LEVELS];
    for (int i = 0; i < 4; ++i) {
        Bands own = bands_at(first + ivec2(i & 1, i >> 1));
        for (int band = 0; band < 3 * LEVELS; ++band) bands[band / 3][band % 3][i] = own.of[band / 4][band % 4];
    }
    add_noise(cell, bands);
}
