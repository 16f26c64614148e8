#version 430
// Fragments as material.frag.glsl would read them, as numbers: place on the texture, rho and eta.

#include "footprint.glsl"

layout(location = 0) out vec4 result;

void main() {
    Footprint own = footprint();
    result = vec4(own.place_px, own.rho, own.eta);
}
