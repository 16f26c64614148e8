#version 430
// Join: fade the displaced picture in beyond the fovea, with the last push of what it lacks; the fovea
// is copied. A call makes 2x2 pixels, which share one factor of the finest level.
// Twin: matched() in displacement.py, finished() in reference.py. Change both or neither.

#constant TILE        // work-group edge, 2x2 pixels
#constant MATCHED     // 1: add what is lacking
#constant SMALLEST_VARIANCE
#constant LEAST_MATCH
#constant MOST_MATCH

#include "pools.glsl"
#include "fade.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform sampler2D source;
uniform sampler2D warped;
layout(rgba32f) uniform writeonly image2D target;
#if MATCHED
// Of resolution 1, linear; see match.comp.glsl.
uniform sampler2D coarse_difference;
uniform sampler2D coarse_own;
uniform sampler2D coarse_change;
uniform sampler2DArray true_moments;  // chosen, of resolution 2
uniform sampler2DArray own_moments;
uniform int has_coarse_change;  // 1: yes

float energy(sampler2DArray moments, vec2 at) {
    vec3 mean = textureLod(moments, vec3(at, 1.0), 0.0).xyz;
    return dot(max(textureLod(moments, vec3(at, 0.0), 0.0).xyz - mean * mean, 0.0), vec3(1.0));
}
#endif

void store(ivec2 pixel, ivec2 size, float gain) {
    if (any(greaterThanEqual(pixel, size))) return;
    vec4 own = texelFetch(source, pixel, 0);
    vec3 changed = texelFetch(warped, pixel, 0).rgb;
    vec2 place = vec2(pixel) + 0.5;
    Place seen = seen_at(place);
#if MATCHED
    vec2 within = 0.5 * place / vec2((size + 1) / 2);
    vec3 added = (gain - 1.0) * (changed - textureLod(coarse_own, within, 0.0).rgb);
    if (has_coarse_change == 1) added += textureLod(coarse_change, within, 0.0).rgb;
    vec3 below = textureLod(coarse_difference, within, 0.0).rgb;
    changed += added + mix(own.rgb - changed, below, beyond_lod(pool_at(seen), 0));
#endif
    imageStore(target, pixel, vec4(faded(own.rgb, changed, seen), own.a));
}

void main() {
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy), first = 2 * cell, size = imageSize(target);
    if (any(greaterThanEqual(first, size))) return;
    float gain = 1.0;
#if MATCHED
    vec2 at = 0.5 * (vec2(cell) + 0.5) / vec2(textureSize(own_moments, 0).xy);
    float wanted = energy(true_moments, at), found = energy(own_moments, at);
    gain = clamp(sqrt((wanted + SMALLEST_VARIANCE) / (found + SMALLEST_VARIANCE)), LEAST_MATCH, MOST_MATCH);
#endif
    store(first, size, gain);
    store(first + ivec2(1, 0), size, gain);
    store(first + ivec2(0, 1), size, gain);
    store(first + 1, size, gain);
}
