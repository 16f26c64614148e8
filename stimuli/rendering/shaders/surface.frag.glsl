#version 430
// One surface point: encoded colour, and its depth along the optical axis.
// Light does not depend on the camera: a surface keeps its colour while one moves.

// Depths are drawn already and written no more, so that only what is seen is lit.

#include "light.glsl"

layout(early_fragment_tests) in;

in vec3 world;
in vec3 normal;
in vec2 uv;
in vec4 tint;

uniform sampler2D albedo;          // linear light (sRGB texture) and coverage
uniform bvec2 clamped;             // whether its edge goes on, along u and v
uniform vec3 emission;             // linear light of the surface's own, ...
uniform sampler2D glow;            // ... and its texture,
uniform bool glowing;              // if it has one
uniform sampler2DShadow shadow;
uniform mat4 shadow_from_world;
uniform bool cutout;
uniform bool lit;
uniform float translucency;
uniform vec3 eye;
uniform vec3 sun_direction;
uniform vec3 sun;
uniform vec3 sky;
uniform vec3 ground;
uniform vec3 haze;                 // linear
uniform float haze_per_m;
uniform float exposure;
uniform float shadow_texel_m;

layout(location = 0) out vec4 result;

#include "coverage.glsl"

float sunlit(vec3 facing) {
    float slope = clamp(1.0 - dot(facing, sun_direction), 0.2, 1.0);
    vec3 place = world + facing * (2.0 * slope * shadow_texel_m);
    vec4 at = shadow_from_world * vec4(place, 1.0);
    vec3 here = 0.5 + 0.5 * at.xyz;
    vec2 texel = 1.0 / vec2(textureSize(shadow, 0));
    float sum = 0.0;
    for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x)
            sum += texture(shadow, vec3(here.xy + 1.2 * vec2(x, y) * texel, here.z - 0.0006));
    return sum / 9.0;
}

void main() {
    vec4 texel = texel_at(albedo, uv);
    if (cutout && uncovered(uv, texel.a)) discard;
    vec3 colour = texel.rgb * tint.rgb;
    if (lit) {
        vec3 facing = normalize(normal);
        if (dot(facing, world - eye) > 0.0) facing = -facing;
        float towards = dot(facing, sun_direction);
        float direct = mix(max(towards, 0.0), 0.35 + 0.45 * abs(towards), translucency);
        float up = 0.5 + 0.5 * facing.y;
        vec3 around = mix(ground, sky, up) * tint.a + ground * 0.35 * (1.0 - tint.a);
        vec3 beam = direct > 0.0 ? sun * direct * sunlit(towards > 0.0 ? facing : -facing)
                                 : vec3(0.0);
        colour = tone_map(exposure * colour * (beam + around));
        // Measured from the scene's own viewpoint, which is the origin.
        colour = mix(haze, colour, exp(-haze_per_m * length(world)));
    }
    colour += glowing ? emission * texel_at(glow, uv).rgb : emission;
    result = vec4(encode(colour), 1.0 / gl_FragCoord.w);
}
