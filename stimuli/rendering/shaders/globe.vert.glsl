#version 430
// A vertex of a globe. Camera axes: x right, y down, z forward; light is fixed, a globe turns under it.

in vec3 in_position;    // metres
in vec3 in_normal;
in vec2 in_uv;

uniform mat4 clip_from_camera;
uniform vec3 light_direction;  // towards the light; zero: everything is lit alike
uniform float ambient;

out vec2 uv;
out float light;

void main() {
    uv = in_uv;
    light = light_direction == vec3(0.0)
          ? 1.0 : ambient + (1.0 - ambient) * max(dot(in_normal, light_direction), 0.0);
    gl_Position = clip_from_camera * vec4(in_position, 1.0);
}
