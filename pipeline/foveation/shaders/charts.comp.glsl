#version 430
// Charts: a panorama and the pictures of its poles as one; the fovea is copied.
// Twin: by_charts() in panorama.py. Change both or neither.

#constant TILE  // work-group edge, pixels

#include "pools.glsl"
#include "cubic.glsl"
#include "sphere.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform sampler2D source;
uniform sampler2D belt;
uniform sampler2D upper;
uniform sampler2D lower;
layout(rgba32f) uniform writeonly image2D target;
uniform float cap_radian_px;

vec3 cap_at(sampler2D cap, vec3 ray) {
    // Its pole lies where `ray` does: 1 + |y| is far from 0.
    float pole = sign(ray.y);
    vec2 place = 2.0 * cap_radian_px / (1.0 + abs(ray.y)) * vec2(ray.x, -pole * ray.z);
    return look_up(cap, 0.5 * vec2(textureSize(cap, 0)) + place, false);
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(target)))) return;
    vec4 own = texelFetch(source, pixel, 0);
    Place seen = seen_at(vec2(pixel) + 0.5);
    vec3 colour = own.rgb;
    if (seen.eccentricity_deg > fovea_deg) {
        colour = texelFetch(belt, pixel, 0).rgb;
        float share = cap_share(seen.ray);
        if (share > 0.0 && seen.ray.y < 0.0) colour = mix(colour, cap_at(upper, seen.ray), share);
        if (share > 0.0 && seen.ray.y > 0.0) colour = mix(colour, cap_at(lower, seen.ray), share);
        colour = clamp(colour, 0.0, 1.0);
    }
    imageStore(target, pixel, vec4(colour, own.a));
}
