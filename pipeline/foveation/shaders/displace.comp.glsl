#version 430
// Displace: the field's last push, and the picture looked up at x + D(x) by a cubic spline.
// A panorama: see displace_sphere.comp.glsl. Twin: displaced() in displacement.py. Change both or neither.

#constant TILE            // work-group edge, pixels
#constant LEAST_VARIANCE  // of the field's pools, over HALVED_VARIANCE
#constant REACH           // deviations from the border within which what crosses it fades out
#constant HALVINGS        // of the field's noise, at most

#include "pools.glsl"
#include "cubic.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform sampler2D source;
uniform sampler2D noise;         // white
uniform sampler2D coarse_field;  // chosen, of resolution 1; linear
layout(rgba32f) uniform writeonly image2D warped;
uniform float reach, smoothness;
// Variance of a level's noise, covariance with and variance of the next one's; see white_energies().
uniform vec3 energies[HALVINGS + 2];

// See _within_frame().
vec2 within_frame(vec2 off, vec2 left, vec2 right, float reach_px) {
    vec2 share = clamp(min(left, right) / max(reach_px, 1e-9), 0.0, 1.0);
    vec2 held = share * share * (3.0 - 2.0 * share) * off;
    return held / (1.0 + abs(held) / mix(left, right, greaterThan(held, vec2(0.0))));
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
    vec2 within = 0.5 * place / vec2((size + 1) / 2);
    vec2 field = mix(texelFetch(noise, pixel, 0).rg, textureLod(coarse_field, within, 0.0).rg,
                     beyond_lod(field_pool, 0));
    vec2 far_off = away * inversesqrt(variance) * field;
    vec2 at = place + within_frame(far_off, place, vec2(size) - place, REACH * away);
    vec3 colour = look_up(source, at, false);
    imageStore(warped, pixel, vec4(colour, 1.0));
}
