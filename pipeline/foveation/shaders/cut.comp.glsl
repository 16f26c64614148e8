#version 430
// Cut: one picture on the left of a line through the gaze, another on its right.
// Twin: bisected() in drawn.py. Change both or neither.

#constant TILE        // work-group edge, pixels

layout(local_size_x = TILE, local_size_y = TILE) in;

uniform sampler2D first;
uniform sampler2D second;
layout(rgba32f) uniform writeonly image2D target;
uniform vec2 centre_px;
uniform float distance_px;
uniform vec3 normal;        // of the plane through the eye and the line, towards `first`
uniform float ramp_deg;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(target)))) return;
    vec3 ray = normalize(vec3(vec2(pixel) + 0.5 - centre_px, distance_px));
    float beyond = degrees(asin(clamp(dot(ray, normal), -1.0, 1.0)));
    float share = clamp(0.5 + beyond / ramp_deg, 0.0, 1.0);
    vec4 left = texelFetch(first, pixel, 0), right = texelFetch(second, pixel, 0);
    imageStore(target, pixel, share >= 1.0 ? left : share <= 0.0 ? right : mix(right, left, share));
}
