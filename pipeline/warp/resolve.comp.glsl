#version 430
// Show at every target pixel what its winning quad carries, and clear the ranks for the
// next call.
// Twin: resolve() in reference.py. Change both or neither.

#constant TILE    // work-group edge, pixels
#constant EXTEND  // whether unreached pixels are continued afterwards

layout(local_size_x = TILE, local_size_y = TILE) in;

#include "warp_mesh.glsl"
#include "warp_rank.glsl"

layout(binding = 2) uniform sampler2D colour;  // encoded R'G'B', source

// rgb: encoded colour, 0 in holes. a: 1 known, 0 hole.
layout(rgba32f, binding = 0) uniform writeonly image2D warped_colour;
// Metres; in holes the background's. 0 where no quad reached: continue.comp.glsl fills it.
layout(r32f, binding = 1) uniform writeonly image2D warped_depth_m;
layout(rg32f, binding = 2) uniform writeonly image2D warped_flow_px;

vec3 colour_at(ivec2 vertex) { return texelFetch(colour, pixel_of(vertex), 0).rgb; }

vec2 flow_at(ivec2 vertex) { return texelFetch(flow_px, pixel_of(vertex), 0).xy; }

// 1 / depth is linear in the image plane. This form gives back one depth of three exactly
// where it alone counts, and where all three are the same.
float blend_depth(float a, float b, float c, vec2 weight) {
    if (weight == vec2(0.0)) return a;
    if (isinf(a)) {
        float inverse = weight.x / b + weight.y / c;
        return inverse > 0.0 ? 1.0 / inverse : INFINITE;
    }
    float ratio = 1.0 + weight.x * (a / b - 1.0) + weight.y * (a / c - 1.0);
    return ratio > 0.0 ? a / ratio : INFINITE;
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, target_size))) return;
    uint cell = uint(pixel.y * target_size.x + pixel.x);
    uint key = keys[cell];
    uint index = winners[cell];
    keys[cell] = NOTHING;
    winners[cell] = NOTHING;

    vec4 shown = vec4(0.0);
    float depth = bool(EXTEND) ? 0.0 : INFINITE;
    vec2 motion = vec2(0.0);
    if (key == NOTHING) {
        unreached = 1u;
    } else {
        ivec2 mesh = mesh_size();
        ivec2 first = ivec2(int(index) % mesh.x, int(index) / mesh.x);
        if ((key & STRETCHED) != 0u) {
            // The farthest corner; the first of equals.
            depth = 0.0;
            for (int corner = 0; corner < 4; ++corner) {
                ivec2 vertex = first + ivec2(corner & 1, corner >> 1);
                float candidate = depth_at(vertex);
                if (candidate > depth) {
                    depth = candidate;
                    motion = flow_at(vertex);
                }
            }
        } else {
            vec2 weight;
            bool upper;
            covers(load_quad(first), pixel, weight, upper);
            ivec2 second = first + (upper ? ivec2(1, 0) : ivec2(1, 1));
            ivec2 third = first + (upper ? ivec2(1, 1) : ivec2(0, 1));
            vec3 base = colour_at(first);
            vec3 mixed = base + weight.x * (colour_at(second) - base)
                       + weight.y * (colour_at(third) - base);
            shown = vec4(clamp(mixed, 0.0, 1.0), 1.0);
            vec2 start = flow_at(first);
            motion = start + weight.x * (flow_at(second) - start)
                   + weight.y * (flow_at(third) - start);
            depth = blend_depth(depth_at(first), depth_at(second), depth_at(third), weight);
        }
    }
    imageStore(warped_colour, pixel, shown);
    imageStore(warped_depth_m, pixel, vec4(depth));
    imageStore(warped_flow_px, pixel, vec4(motion, 0.0, 0.0));
}
