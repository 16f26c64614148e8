#version 430
// A surface with a baked texture, seen by an eye: each pixel picks its level of detail from the
// texture's derivatives and from how widely the eye pools there.

#include "footprint.glsl"
#include "baked.glsl"

in float light;          // linear factor

uniform float strength;  // of the noise; 0: a blur

layout(location = 0) out vec4 result;

// sRGB; twin: colour.py.
vec3 decoded(vec3 c) { return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c)); }
vec3 encoded(vec3 c) { return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c)); }

void main() {
    Footprint own = footprint();
    vec3 colour = baked_colour(own.place_px, own.rho, own.eta, foveated ? strength : 0.0);
    result = vec4(encoded(light * decoded(clamp(colour, 0.0, 1.0))), 1.0);
}
