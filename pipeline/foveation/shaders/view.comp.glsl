#version 430
// View: a flat view of a panorama, and where each of its pixels finds the noise of its direction.
// Twin: flat_view() and anchored_shift_px() in view.py. Change both or neither.

#constant TILE        // work-group edge, pixels
#constant SAMPLES     // of the panorama, along each edge of a pixel
#constant BELT_SINE   // of the latitude from which on noise lies around a pole

#include "panorama.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform sampler2D panorama;
layout(rgba32f) uniform writeonly image2D view;
layout(rg32f) uniform writeonly image2D shift_px;
uniform mat3 turned;        // takes the view's directions to the panorama's
uniform vec2 centre_px;
uniform float distance_px;
uniform float belt_px;      // of noise, for a radian of longitude

vec3 ray_at(vec2 place) { return turned * normalize(vec3(place - centre_px, distance_px)); }

vec2 noise_place(vec3 ray) {
    if (abs(ray.y) <= BELT_SINE)
        return vec2(belt_px * atan(ray.x, ray.z), distance_px * atan(ray.y, length(ray.xz)));
    return 2.0 * distance_px / (1.0 + abs(ray.y)) * vec2(ray.x, sign(ray.y) * ray.z);
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(view)))) return;
    vec3 total = vec3(0.0);
    for (int i = 0; i < SAMPLES * SAMPLES; ++i) {
        vec2 within = (vec2(i % SAMPLES, i / SAMPLES) + 0.5) / float(SAMPLES);
        total += seen_in(panorama, ray_at(vec2(pixel) + within));
    }
    imageStore(view, pixel, vec4(clamp(total / float(SAMPLES * SAMPLES), 0.0, 1.0), 1.0));
    vec2 centre = vec2(pixel) + 0.5;
    imageStore(shift_px, pixel, vec4(centre - noise_place(ray_at(centre)), 0.0, 0.0));
}
