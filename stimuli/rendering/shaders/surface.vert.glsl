#version 430
// A vertex of the world, for the picture and for shadow maps.

in vec3 in_position;    // metres, relative to the renderer's origin
in vec3 in_normal;
in vec2 in_uv;
in vec4 in_colour;      // rgb: linear factor; a: share of the sky that it sees

uniform mat4 clip_from_world;

out vec3 world;
out vec3 normal;
out vec2 uv;
out vec4 tint;

invariant gl_Position;  // two programs draw it, and their depths must be equal

void main() {
    world = in_position;
    normal = in_normal;
    uv = in_uv;
    tint = in_colour;
    gl_Position = clip_from_world * vec4(in_position, 1.0);
}
