#version 430
// Sky behind everything: a panorama at infinite depth.

in vec2 place;

uniform vec2 size_px;
uniform vec2 focal_px;
uniform vec2 centre_px;
uniform mat3 world_from_camera;
uniform bool has_panorama;
uniform vec3 backdrop;             // encoded
uniform sampler2D panorama;        // encoded

layout(location = 0) out vec4 result;

const float PI = 3.14159265358979;
const float INFINITE = uintBitsToFloat(0x7f800000u);

void main() {
    vec3 colour = backdrop;
    if (has_panorama) {
        vec3 ray = world_from_camera * vec3((place * size_px - centre_px) / focal_px, 1.0);
        ray = normalize(ray);
        vec2 at = vec2(atan(ray.x, -ray.z) / (2.0 * PI) + 0.5, acos(clamp(ray.y, -1.0, 1.0)) / PI);
        colour = textureLod(panorama, at, 0.0).rgb;
    }
    result = vec4(colour, INFINITE);
}
