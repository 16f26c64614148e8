#version 430
// Displace: a panorama, or its pole, looked up in directions moved at random, by a cubic spline.
// Twin: displaced() in displacement.py, displaced_rays() in sphere.py. Change both or neither.

#constant TILE    // work-group edge, pixels
#constant FINEST  // power of two of the finest lattice's spacing, radians

#include "pools.glsl"
#include "cubic.glsl"
#include "hashing.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform sampler2D source;
layout(rgba32f) uniform writeonly image2D warped;
uniform float reach, smoothness;
uniform uvec3 key;

// Blend the vectors of the 27 nearest points of a lattice of spacing 2^level.
vec3 lattice_noise(vec3 ray, int level) {
    vec3 place = ray * exp2(float(-level)), nearest = floor(place + 0.5), aside = place - nearest;
    vec3 weights[3] = vec3[](0.5 * (0.5 - aside) * (0.5 - aside), 0.75 - aside * aside,
                             0.5 * (0.5 + aside) * (0.5 + aside));
    vec3 total = vec3(0.0);
    uvec3 salt = key ^ uvec3(0u, 0u, uint(level) * 0x9E3779B9u);
    ivec3 corner = ivec3(nearest) - 1;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            for (int k = 0; k < 3; ++k) {
                uvec3 bits = pcg3d(uvec3(corner + ivec3(i, j, k)) ^ salt);
                total += weights[i].x * weights[j].y * weights[k].z * (vec3(bits >> 8u) * exp2(-24.0) - 0.5);
            }
    vec3 energy = weights[0] * weights[0] + weights[1] * weights[1] + weights[2] * weights[2];
    return total * sqrt(12.0 / (energy.x * energy.y * energy.z));
}

vec3 unit_noise(vec3 ray, float smooth_rad) {
    float power = log2(max(2.0 * smooth_rad, exp2(float(FINEST))));
    int level = int(floor(power));
    float turn = 0.5 * PI * (power - float(level));
    return cos(turn) * lattice_noise(ray, level) + sin(turn) * lattice_noise(ray, level + 1);
}

vec2 place_of(vec3 ray) {
#if PROJECTION == 1
    return vec2(atan(ray.x, ray.z) / (2.0 * PI) + 0.5, atan(ray.y, length(ray.xz)) / PI + 0.5) * picture_px;
#else
    float scale = 2.0 * radian_px / max(1.0 + pole * ray.y, 1e-6);
    return 0.5 * picture_px + scale * vec2(ray.x, -pole * ray.z);
#endif
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(warped)))) return;
    Place seen = seen_at(vec2(pixel) + 0.5);
    float sigma = radians(sqrt(pool_at(seen) * HALVED_VARIANCE / seen.square_deg_px));
    vec3 noise = unit_noise(seen.ray, smoothness * sigma);
    noise -= dot(noise, seen.ray) * seen.ray;
    vec2 at = place_of(normalize(seen.ray + reach * sigma * noise));
    imageStore(warped, pixel, vec4(look_up(source, at, PROJECTION == 1), 1.0));
}
