#version 430
// Carry colour and tensors to one shell, and list the next one.
// Twin: transported(), coherence() and shells() in reference.py. Change both or neither.

#constant RADIUS_PX
#constant CARRY_PX
#constant COHERENCE
#constant FAINT
#constant LEAST_DIFFERENCE

#include "pixels.glsl"
#include "transport.glsl"

layout(std430) buffer Listed { uint listed[]; };  // hole pixels: 1 in a shell, 0 not yet

layout(std140) uniform Step {
    float shell;
    int ways;  // to the next shell: 4 along rows and columns, 8 along diagonals too
    uvec2 next_list;
};

// A pixel that no shell has reached, or that lies at another depth, is not seen. Both are loaded before that
// is known: loads behind branches wait for each other.
bool is_seen(float reached, float there, ivec2 place, float guide) {
    return is_inside(place) && reached < shell && is_alike(guide, there);
}

vec3 mean_tensor(ivec2 pixel, float guide) {
    vec4 total = vec4(0.0);
    for (int y = -CARRY_PX; y <= CARRY_PX; ++y) {
        for (int x = -CARRY_PX; x <= CARRY_PX; ++x) {
            ivec2 along = ivec2(x, y), place = pixel + along;
            if (!in_disc(along, CARRY_PX)) continue;
            vec4 tensor = imageLoad(tensors, place);
            float there = imageLoad(moved, place).a;
            if (is_seen(tensor.a, there, place, guide)) total += vec4(tensor.rgb, 1.0) / float(x * x + y * y);
        }
    }
    return total.rgb / total.a;
}

// Mu times the direction across the structure, over the radius.
vec2 coherence(vec3 tensor) {
    float apart = tensor.x - tensor.z, twice = 2.0 * tensor.y;
    float difference = sqrt(apart * apart + twice * twice);
    if (difference == 0.0) return vec2(0.0);
    float angle = 0.5 * atan(twice, apart), faint = FAINT * FAINT / difference;
    float mu = 1.0 + COHERENCE * exp(-faint * faint);
    mu *= difference / (difference + LEAST_DIFFERENCE);
    return mu / float(RADIUS_PX) * vec2(cos(angle), sin(angle));
}

vec3 mean_colour(ivec2 pixel, float guide, vec2 across) {
    vec4 total = vec4(0.0);
    for (int y = -RADIUS_PX; y <= RADIUS_PX; ++y) {
        for (int x = -RADIUS_PX; x <= RADIUS_PX; ++x) {
            ivec2 along = ivec2(x, y), place = pixel + along;
            if (!in_disc(along, RADIUS_PX)) continue;
            vec4 there = imageLoad(moved, place);
            float reached = imageLoad(tensors, place).a, off = dot(across, vec2(along));
            float weight = exp(-0.5 * off * off) * inversesqrt(float(x * x + y * y));
            if (is_seen(reached, there.a, place, guide)) total += weight * vec4(there.rgb, 1.0);
        }
    }
    return total.rgb / total.a;
}

void work(ivec2 pixel, int chain) {
    float guide = imageLoad(moved, pixel).a;
    vec3 tensor = mean_tensor(pixel, guide);
    vec3 colour = mean_colour(pixel, guide, coherence(tensor));
    imageStore(moved, pixel, vec4(colour, guide));
    imageStore(tensors, pixel, vec4(tensor, shell));
    for (int k = 0; k < ways; ++k) {
        ivec2 place = pixel + neighbour(k);
        if (!is_inside(place) || is_known(place) || !is_worked(place, 0)) continue;
        if (!is_alike(guide, guide_at(place))) continue;
        uint number = uint(place.y * imageSize(image).x + place.x);
        if (atomicExchange(listed[number], 1u) == 0u) append(next_list.x, next_list.y, place, 0);
    }
}
