#version 430
// Depth alone, of cut-outs: for shadow maps, and ahead of the costly light.

in vec2 uv;

uniform sampler2D albedo;
uniform bvec2 clamped;

#include "coverage.glsl"

void main() {
    if (uncovered(uv, texel_at(albedo, uv).a)) discard;
}
