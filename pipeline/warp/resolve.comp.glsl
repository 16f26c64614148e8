#version 430
// Show at every target pixel what its winning quad carries, and clear the ranks for the
// next call.
// Twin: resolve() in reference.py. Change both or neither.

#constant TILE    // work-group edge, pixels
#constant EXTEND  // whether unreached pixels are continued afterwards

layout(local_size_x = TILE, local_size_y = TILE) in;

#include "warp_mesh.glsl"
#include "warp_rank.glsl"

layout(rgba32f) uniform readonly image2D colour;  // encoded R'G'B', source

// rgb: encoded colour, 0 in holes. a: 1 known, 0 hole.
layout(rgba32f) uniform writeonly image2D warped_colour;
// Metres; in holes the background's. 0 where no quad reached: continue.comp.glsl fills it.
layout(r32f) uniform writeonly image2D warped_depth_m;
layout(rg32f) uniform writeonly image2D warped_flow_px;

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

// Column and row of a number, counted row by row; exact. llvmpipe divides whole numbers lane by lane.
ivec2 place_of(int index, int columns) {
    int row = int(float(index) / float(columns));  // off by one at most
    int column = index - row * columns;
    if (column < 0) return ivec2(column + columns, row - 1);
    if (column >= columns) return ivec2(column - columns, row + 1);
    return ivec2(column, row);
}

vec3 colour_at(ivec2 first, int part, int k) {
    return imageLoad(colour, pixel_of(first + corner(source_of(part, k)))).rgb;
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, target_size))) return;
    uint cell = uint(pixel.y * target_size.x + pixel.x);
    uint key = keys[cell];
    uint index = winners[cell];
    keys[cell] = NOTHING;
    winners[cell] = NOTHING;

    if (key == NOTHING) {
        if (bool(EXTEND)) unreached = 1u;
        imageStore(warped_colour, pixel, vec4(0.0));
        imageStore(warped_depth_m, pixel, vec4(bool(EXTEND) ? 0.0 : INFINITE));
        imageStore(warped_flow_px, pixel, vec4(0.0));
        return;
    }
    ivec2 mesh = mesh_size();
    uint quads = uint(mesh.x * mesh.y);
    int part = 0;
    if (index >= quads) {  // few are: whole pieces of a frame have none
        part = int(index / quads);
        index -= uint(part) * quads;
    }
    ivec2 first = place_of(int(index), mesh.x);
    Quad quad = load_quad(first, part);

    vec4 shown = vec4(0.0);
    // In holes the farthest corner; the first of equals, in reading order.
    float depth = quad.depth.x;
    vec2 motion = quad.fa;
    if (quad.depth.y > depth) { depth = quad.depth.y; motion = quad.fb; }
    if (quad.depth.w > depth) { depth = quad.depth.w; motion = quad.fd; }
    if (quad.depth.z > depth) { depth = quad.depth.z; motion = quad.fc; }
    if ((key & STRETCHED) == 0u) {
        ivec2 centre = pixel * SUB + SUB / 2;
        ivec2 a = quad.a - centre, b = quad.b - centre, c = quad.c - centre, d = quad.d - centre;
        Areas area;
        if (max(max(longest(a), longest(b)), max(longest(c), longest(d))) <= NARROW)
            area = narrow_areas(a, b, c, d);
        else
            area = wide_areas(a, b, c, d);
        vec2 weight;
        bool upper;
        covers(quad, area, weight, upper);

        vec3 base = colour_at(first, part, 0);
        vec3 second = colour_at(first, part, upper ? 1 : 2);
        vec3 third = colour_at(first, part, upper ? 2 : 3);
        vec3 mixed = base + weight.x * (second - base) + weight.y * (third - base);
        shown = vec4(clamp(mixed, 0.0, 1.0), 1.0);
        motion = quad.fa + weight.x * ((upper ? quad.fb : quad.fc) - quad.fa)
               + weight.y * ((upper ? quad.fc : quad.fd) - quad.fa);
        vec2 rest = upper ? quad.depth.yz : quad.depth.zw;
        depth = blend_depth(quad.depth.x, rest.x, rest.y, weight);
    }
    imageStore(warped_colour, pixel, shown);
    imageStore(warped_depth_m, pixel, vec4(depth));
    imageStore(warped_flow_px, pixel, vec4(motion, 0.0, 0.0));
}
