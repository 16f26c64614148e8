#version 430
// Join: fade the displaced picture in beyond the fovea, with all it lacked; the fovea is copied.
// Twin: finished() in reference.py. Change both or neither.

#constant TILE        // work-group edge, pixels
#constant FADE_SHARE  // of the fovea's radius: over it what is changed fades in
#constant MATCHED     // 1: add what was lacking

#include "pools.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

layout(binding = 0) uniform sampler2D source;
layout(binding = 1) uniform sampler2D warped;
#if MATCHED
layout(binding = 2) uniform sampler2D difference;
layout(binding = 3) uniform sampler2D change;
#endif
layout(rgba32f, binding = 0) uniform writeonly image2D target;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(target)))) return;
    vec4 own = texelFetch(source, pixel, 0);
    vec3 changed = texelFetch(warped, pixel, 0).rgb;
#if MATCHED
    changed += texelFetch(difference, pixel, 0).rgb + texelFetch(change, pixel, 0).rgb;
#endif
    float away = seen_at(vec2(pixel) + 0.5).eccentricity_deg - fovea_deg;
    float fade = fovea_deg > 0.0 ? clamp(away / (FADE_SHARE * fovea_deg), 0.0, 1.0) : float(away > 0.0);
    vec3 result = clamp(own.rgb + fade * (changed - own.rgb), 0.0, 1.0);
    imageStore(target, pixel, vec4(fade > 0.0 ? result : own.rgb, own.a));
}
