// A surface's colour from its baked texture: the texture at a level of detail, and noise of what is
// lost up to it. Twin: textures/reference.py and textures/surface_noise.py. Change both or neither.

#constant HALVINGS         // of the texture; as many levels have moments
#constant WRAPS            // 1: its right border goes on at the left one
#constant GRAIN            // step of the noise
#constant NOISE_PER_TEXEL  // pixels of noise at a level's texel; two texels each
#constant OVERLAP_REACH    // levels of which a band measures something
#constant OVERLAP_STAGES
#constant GAIN_STEPS
#constant LEAST_GAIN
#constant MOST_GAIN
#constant UNSEEN_VARIANCE

#include "bounded.glsl"
#include "interpolated.glsl"
#include "ycbcr.glsl"

// Resolutions stand below one another: 0 and coarser of colour, k + 1 and coarser of level k's
// moments. A texel of moments is eight half floats.
uniform sampler2D colour_mips;
uniform usampler2D moment_mips[HALVINGS];
uniform usampler2D noise_tiles;  // below one another; signed bytes: high, along x, along y
uniform ivec4 noise_of_level[HALVINGS];   // its tile's first row, rows, columns; and nothing
uniform ivec2 noise_offset_px[HALVINGS];
uniform vec4 noise_lags[3];               // lags (0, 1), (1, 0), (1, 1), (1, -1)
uniform mat3 overlap[OVERLAP_STAGES * (2 * OVERLAP_REACH + 1)];

ivec2 size_at(int r) { return (texture_px + (1 << r) - 1) >> r; }

// First row of resolution r, where `first` is the uppermost.
int row_at(int first, int r) {
    int row = 0;
    for (int n = first; n < r; ++n) row += size_at(n).y;
    return row;
}

// Four texels of a linear look-up at resolution r.
struct Taps { ivec2 a, b, c, d; vec4 weight; };

Taps taps_at(vec2 place_px, int first, int r) {
    vec2 place = place_px / float(1 << r) - 0.5;
    ivec2 corner = ivec2(floor(place)), size = size_at(r);
    int left = corner.x, right = corner.x + 1;
#if WRAPS
    left = (left % size.x + size.x) % size.x;
    right = (right % size.x + size.x) % size.x;
#else
    left = clamp(left, 0, size.x - 1);
    right = clamp(right, 0, size.x - 1);
#endif
    int above = row_at(first, r) + clamp(corner.y, 0, size.y - 1);
    int below = row_at(first, r) + clamp(corner.y + 1, 0, size.y - 1);
    return Taps(ivec2(left, above), ivec2(right, above), ivec2(left, below), ivec2(right, below),
                bilinear(place - floor(place)));
}

vec3 colour_at(vec2 place_px, int r) {
    Taps t = taps_at(place_px, 0, r);
    return t.weight.x * texelFetch(colour_mips, t.a, 0).rgb + t.weight.y * texelFetch(colour_mips, t.b, 0).rgb
         + t.weight.z * texelFetch(colour_mips, t.c, 0).rgb + t.weight.w * texelFetch(colour_mips, t.d, 0).rgb;
}

struct Moments { vec3 square, mean; vec2 cross; };

void add(inout Moments sum, float weight, uvec4 texel) {
    vec2 a = unpackHalf2x16(texel.x), b = unpackHalf2x16(texel.y);
    vec2 c = unpackHalf2x16(texel.z), d = unpackHalf2x16(texel.w);
    sum.square += weight * vec3(a, b.x);
    sum.mean += weight * vec3(b.y, c);
    sum.cross += weight * d;
}

#define ADD_MOMENTS(sum, share, mips, r, k)                       \
    {                                                             \
        Taps t = taps_at(place_px, k + 1, r);                     \
        add(sum, share * t.weight.x, texelFetch(mips, t.a, 0));   \
        add(sum, share * t.weight.y, texelFetch(mips, t.b, 0));   \
        add(sum, share * t.weight.z, texelFetch(mips, t.c, 0));   \
        add(sum, share * t.weight.w, texelFetch(mips, t.d, 0));   \
    }

vec3 noise_bands(uint texel) { return unpackSnorm4x8(texel).rgb * (127.0 * GRAIN); }

// A level's noise, of unit variance: interpolated it has less, which is given back.
vec3 noise_at(int k, vec2 place_px) {
    vec2 anchor = place_px * (float(NOISE_PER_TEXEL) / float(1 << k)) + vec2(noise_offset_px[k]);
    vec2 place = 2.0 * (anchor - 0.5);
    ivec4 tile = noise_of_level[k];
    ivec2 a = ivec2(floor(place)), d = a + 1;
    a = ivec2((a.x % tile.z + tile.z) % tile.z, tile.x + (a.y % tile.y + tile.y) % tile.y);
    d = ivec2((d.x % tile.z + tile.z) % tile.z, tile.x + (d.y % tile.y + tile.y) % tile.y);
    vec4 w = bilinear(place - floor(place));
    vec3 found = w.x * noise_bands(texelFetch(noise_tiles, a, 0).r)
               + w.y * noise_bands(texelFetch(noise_tiles, ivec2(d.x, a.y), 0).r)
               + w.z * noise_bands(texelFetch(noise_tiles, ivec2(a.x, d.y), 0).r)
               + w.w * noise_bands(texelFetch(noise_tiles, d, 0).r);
    return found * inversesqrt(vec3(kept_variance(w, noise_lags[0]), kept_variance(w, noise_lags[1]),
                                    kept_variance(w, noise_lags[2])));
}

float lost_energy(int k, float rho, float lod) {
    float shown = clamp(float(k + 1) - rho, 0.0, 1.0), kept = clamp(float(k + 1) - lod, 0.0, 1.0);
    return max(shown * shown - kept * kept, 0.0);
}

// place_px: on the texture, in its finest texels. rho: logarithm of texels per pixel. eta: level of
// detail of the pool, in pixels. `strength` is what noise is multiplied by; 0: a foveated blur.
vec3 baked_colour(vec2 place_px, float rho, float eta, float strength) {
    float lod = clamp(rho + eta, 0.0, float(HALVINGS));
    int fine = min(int(lod), HALVINGS - 1);
    vec3 base = mix(colour_at(place_px, fine), colour_at(place_px, fine + 1), lod - float(fine));
    if (strength == 0.0) return base;
    vec3 asked[HALVINGS];
    vec2 slopes[HALVINGS];
    for (int k = 0; k < HALVINGS; ++k) {
        float lost = lost_energy(k, rho, lod);
        asked[k] = vec3(0.0);
        slopes[k] = vec2(0.0);
        if (lost > 0.0) {
            Moments found = Moments(vec3(0.0), vec3(0.0), vec2(0.0));
            float own = clamp(lod, float(k + 1), float(HALVINGS));
            int r = clamp(int(own), k + 1, max(k + 1, HALVINGS - 1));
            float share = own - float(r);
            ADD_MOMENTS(found, (1.0 - share), moment_mips[k], r, k)
            if (share > 0.0) ADD_MOMENTS(found, share, moment_mips[k], (r + 1), k)
            asked[k] = lost * max(found.square - found.mean * found.mean, 0.0);
            slopes[k] = found.cross / (found.square.x + found.square.y + found.square.z + SMALLEST_VARIANCE);
        }
    }
    vec3 given[HALVINGS], measured[HALVINGS];  // measure all, then mend: Mesa 25 gets it wrong from copies
    for (int k = 0; k < HALVINGS; ++k) given[k] = asked[k];
    for (int n = 0; n < GAIN_STEPS; ++n) {
        for (int k = 0; k < HALVINGS; ++k) {
            measured[k] = vec3(0.0);
            if (asked[k] == vec3(0.0)) continue;
            float finer = clamp(float(k) - rho, 0.0, float(OVERLAP_STAGES - 1));
            int stage = min(int(finer), OVERLAP_STAGES - 2);
            float share = finer - float(stage);
            for (int d = -OVERLAP_REACH; d <= OVERLAP_REACH; ++d)
                if (k + d >= 0 && k + d < HALVINGS) {
                    int form = stage * (2 * OVERLAP_REACH + 1) + OVERLAP_REACH + d;
                    measured[k] += mix(overlap[form] * given[k + d],
                                       overlap[form + 2 * OVERLAP_REACH + 1] * given[k + d], share);
                }
        }
        for (int k = 0; k < HALVINGS; ++k)
            given[k] *= (asked[k] + UNSEEN_VARIANCE) / (measured[k] + UNSEEN_VARIANCE);
    }
    vec3 noise = vec3(0.0), cross_luma = vec3(0.0);
    vec4 variance = vec4(0.0);  // of R'G'B' and luma; independent by level and band
    for (int k = 0; k < HALVINGS; ++k)
        if (asked[k] != vec3(0.0)) {
            vec3 least = LEAST_GAIN * LEAST_GAIN * asked[k], most = MOST_GAIN * MOST_GAIN * asked[k];
            vec3 own = clamp(given[k], least, most);
            vec3 along = RGB_FROM_YCBCR * vec3(1.0, slopes[k]);
            float square = own.x + own.y + own.z;
            variance += square * vec4(along * along, 1.0);
            cross_luma += square * along;
            noise += dot(sqrt(own), noise_at(k, place_px)) * along;
        }
    return added(base, strength * noise, spread_of(strength * strength * variance.rgb, cross_luma, variance));
}
