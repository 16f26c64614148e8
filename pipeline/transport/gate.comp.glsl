#version 430
// Part that coefficients of 4x4 pixels take in the statistics: none where the picture has one direction.
// Visits tiles in which moments are made.
// Twin: texture_parts() in reference.py. Change both or neither.

#constant GATE_LOG2
#constant ROUND
#constant DIRECTED
#constant FAINT

#include "tiles.glsl"
#include "transport.glsl"
#include "transport/tensor.glsl"

layout(r32f) uniform writeonly image2D gate;

float part(vec3 tensor) {
    float total = tensor.x + tensor.z, apart = tensor.x - tensor.z, twice = 2.0 * tensor.y;
    float difference = sqrt(apart * apart + twice * twice);
    float share = total > 0.0 ? difference / total : 0.0;
    float directed = clamp((share - ROUND) / (DIRECTED - ROUND), 0.0, 1.0);
    return 1.0 - directed * clamp((total + difference) / (2.0 * FAINT * FAINT) - 1.0, 0.0, 1.0);
}

// `block` covers 2x2 texels of the gate.
void work(ivec2 block, int chain) {
    ivec2 last = imageSize(image) - 1;
    for (int child = 0; child < 4; ++child) {
        ivec2 place = 2 * block + ivec2(child & 1, child >> 1);
        if (any(greaterThanEqual(place, imageSize(gate)))) continue;
        ivec2 middle = min((place << GATE_LOG2) + (1 << GATE_LOG2) / 2, last);
        vec3 tensor = is_known(middle) ? tensor_at(middle, guide_at(middle)) : vec3(0.0);
        imageStore(gate, place, vec4(part(tensor)));
    }
}
