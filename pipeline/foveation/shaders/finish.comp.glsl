#version 430
// Finish: the last push of a blur, faded in beyond the fovea and clipped; the fovea is copied.
// With noise: finish_screen.comp.glsl, finish_carried.comp.glsl.
// Twin: blur() in reference.py. Change both or neither.

#constant TILE  // work-group edge, pixels

#include "pools.glsl"
#include "fade.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform sampler2D source;
uniform sampler2D coarse;  // chosen, linear
layout(rgba32f) uniform writeonly image2D target;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy), size = textureSize(source, 0);
    if (any(greaterThanEqual(pixel, size))) return;
    vec4 own = texelFetch(source, pixel, 0);
    vec2 place = vec2(pixel) + 0.5;
    Place seen = seen_at(place);
    vec3 below = textureLod(coarse, 0.5 * place / vec2((size + 1) / 2), 0.0).rgb;
    vec3 base = mix(own.rgb, below, beyond_lod(pool_at(seen), 0));
    imageStore(target, pixel, vec4(faded(own.rgb, base, seen), own.a));
}
