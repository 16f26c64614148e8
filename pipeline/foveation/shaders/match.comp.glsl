#version 430
// Match: one push of what the displaced picture lacks: the difference of pools' means, and what each
// band adds too little. Resolutions from 1 on. Twin: matched() in displacement.py. Change both or neither.

#constant TILE               // work-group edge, texels
#constant LEVEL              // 1: this resolution is a pyramid level (not the finest: join.comp.glsl)
#constant WRAPS              // 1: the picture goes on at its other side
#constant SMALLEST_VARIANCE
#constant LEAST_MATCH
#constant MOST_MATCH
#constant ORIENTED_EDGE      // taps of the 3x3 oriented kernel: right column, centre row,
#constant ORIENTED_CORNER    // other rows
#constant DEEPEST            // 1: there is nothing coarser

#include "pools.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform int halvings;
uniform sampler2D true_low;    // of this resolution: the picture
uniform sampler2D own_low;     // and the displaced one
layout(rgba16f) uniform writeonly image2D difference;
#if !DEEPEST
uniform sampler2D coarse_difference;  // linear
#endif
#if LEVEL
layout(rgba16f) uniform writeonly image2D change;
uniform sampler2D coarse_own;     // the displaced one, halved once more; linear
uniform sampler2D coarse_change;  // linear
uniform sampler2DArray true_moments;  // chosen, of resolution `moments_at`
uniform sampler2DArray own_moments;
uniform int moments_at;
uniform int has_coarse_change;  // 1: yes

vec3 variance_of(sampler2DArray moments, vec2 at) {
    vec3 mean = textureLod(moments, vec3(at, float(2 * halvings + 1)), 0.0).xyz;
    return max(textureLod(moments, vec3(at, float(2 * halvings)), 0.0).xyz - mean * mean, 0.0);
}

vec3 low_at(ivec2 texel) {
    ivec2 size = textureSize(own_low, 0);
#if WRAPS
    texel.x = (texel.x + 4 * size.x) % size.x;
#endif
    return texelFetch(own_low, clamp(texel, ivec2(0), size - 1), 0).rgb;
}

float match_of(float wanted, float found) {
    return clamp(sqrt((wanted + SMALLEST_VARIANCE) / (found + SMALLEST_VARIANCE)), LEAST_MATCH, MOST_MATCH);
}
#endif

void main() {
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy), size = imageSize(difference);
    if (any(greaterThanEqual(texel, size))) return;
    vec2 place = vec2(texel) + 0.5, within = 0.5 * place / vec2((size + 1) / 2);
    vec3 own = texelFetch(own_low, texel, 0).rgb;
    vec3 apart = texelFetch(true_low, texel, 0).rgb - own;
#if !DEEPEST
    float share = beyond_lod(pool_at(seen_at(place * float(1 << halvings))), halvings);
    apart = mix(apart, textureLod(coarse_difference, within, 0.0).rgb, share);
#endif
    imageStore(difference, texel, vec4(apart, 0.0));
#if LEVEL
    vec2 at = place / float(1 << (moments_at - halvings)) / vec2(textureSize(own_moments, 0).xy);
    vec3 wanted = variance_of(true_moments, at), found = variance_of(own_moments, at);
    vec3 detail = own - textureLod(coarse_own, within, 0.0).rgb;
    vec3 added = has_coarse_change == 1 ? textureLod(coarse_change, within, 0.0).rgb : vec3(0.0);
    const float c = ORIENTED_CORNER, e = ORIENTED_EDGE;
    const float outer = c * c, between = 2.0 * c * e, middle = 2.0 * c * c + e * e;
    vec3 along_x = vec3(0.0), along_y = vec3(0.0);
    // A row of the texels that both directions read; `across` weighs it along y.
#define ROW(offset, weight, across)                                                              \
    {                                                                                            \
        vec3 left = low_at(texel + ivec2(-2, offset)), here = low_at(texel + ivec2(0, offset));  \
        vec3 right = low_at(texel + ivec2(2, offset));                                           \
        along_x += weight * (2.0 * here - left - right);                                         \
        along_y += (across) * (outer * (left + right) + middle * here);                          \
    }
#define BESIDE(offset, across)                                                                   \
    along_y += (across) * between * (low_at(texel + ivec2(-1, offset)) + low_at(texel + ivec2(1, offset)));
    ROW(-2, outer, -1.0) ROW(-1, between, 0.0) ROW(0, middle, 2.0) ROW(1, between, 0.0) ROW(2, outer, -1.0)
    BESIDE(-2, -1.0) BESIDE(0, 2.0) BESIDE(2, -1.0)
    added += (match_of(wanted.x, found.x) - 1.0) * (detail - along_x - along_y)
           + (match_of(wanted.y, found.y) - 1.0) * along_x + (match_of(wanted.z, found.z) - 1.0) * along_y;
    imageStore(change, texel, vec4(added, 0.0));
#endif
}
