#version 430
// Depth alone, through cut-outs: for shadow maps, and ahead of the costly light.

in vec2 uv;

uniform sampler2D albedo;
uniform bool cutout;

#include "coverage.glsl"

void main() {
    if (cutout && uncovered(uv, texture(albedo, uv).a)) discard;
}
