#version 430
// Tail: the last resolutions, down to 1x1 and back, in one work group per chain.
// A dispatch for each would cost more than its few texels.
// Twin: pull_push() in reference.py. Change both or neither.

#constant TILE
#constant GROUP         // work-group size
#constant PLANES        // layers a chain
#constant MOST_CHAINS
#constant CHAIN_TEXELS  // of all resolutions here together

#include "guided.glsl"

#define LAST uint(PLANES - 1)

layout(local_size_x = GROUP) in;

layout(std430, binding = 3) readonly buffer Active { uint active_tiles[]; };
layout(std430, binding = 5) coherent buffer Scratch { vec4 scratch[]; };
layout(binding = 0) uniform sampler2DArray base;  // holds the guide
layout(rgba32f, binding = 0) uniform image2DArray top;  // PLANES layers a chain

uniform float gamma;
uniform ivec2 top_size;
uniform uint top_columns;             // tiles per row
uniform uint top_first[MOST_CHAINS];  // where a chain's active tiles start
uniform uint base_first;              // the same for the base chain

uint address(uint first, ivec2 size, ivec2 pixel) {
    uint texel = first + uint(pixel.y * size.x + pixel.x);
    return (gl_WorkGroupID.x * uint(CHAIN_TEXELS) + texel) * uint(PLANES);
}

ivec2 halved(ivec2 size) { return (size + 1) >> 1; }

bool is_active(uint first, ivec2 tile) {
    return active_tiles[first + uint(tile.y) * top_columns + uint(tile.x)] != 0u;
}

void load_top() {
    int chain = int(gl_WorkGroupID.x);
    for (int i = int(gl_LocalInvocationID.x); i < top_size.x * top_size.y; i += GROUP) {
        ivec2 pixel = ivec2(i % top_size.x, i / top_size.x);
        uint place = address(0u, top_size, pixel);
        bool known = is_active(top_first[chain], pixel / TILE);
        for (int p = 0; p < PLANES; ++p) {
            scratch[place + uint(p)] =
                known ? imageLoad(top, ivec3(pixel, chain * PLANES + p)) : vec4(0.0);
        }
        scratch[place + LAST].w =
            is_active(base_first, pixel / TILE) ? texelFetch(base, ivec3(pixel, 1), 0).w : 0.0;
    }
}

void pull_level(uint fine_first, ivec2 fine_size, uint coarse_first, ivec2 coarse_size) {
    for (int i = int(gl_LocalInvocationID.x); i < coarse_size.x * coarse_size.y; i += GROUP) {
        ivec2 pixel = ivec2(i % coarse_size.x, i / coarse_size.x);
        ivec2 near = 2 * pixel;
        ivec2 far = min(near + 1, fine_size - 1);
        uint a = address(fine_first, fine_size, near);
        uint b = address(fine_first, fine_size, ivec2(far.x, near.y));
        uint c = address(fine_first, fine_size, ivec2(near.x, far.y));
        uint d = address(fine_first, fine_size, far);
        vec4 validity = vec4(scratch[a].w, scratch[b].w, scratch[c].w, scratch[d].w);
        vec4 guide = vec4(scratch[a + LAST].w, scratch[b + LAST].w, scratch[c + LAST].w,
                          scratch[d + LAST].w);
        float deepest = farthest(guide);
        Pull pulled = pull_shares(validity, guide, deepest);
        uint place = address(coarse_first, coarse_size, pixel);
        for (uint p = 0u; p < PLANES; ++p) {
            vec4 parent = mixed(pulled.share, scratch[a + p], scratch[b + p], scratch[c + p],
                                scratch[d + p]);
            if (p == 0u) parent.w = pulled.confidence;
            if (p == LAST) parent.w = deepest;
            scratch[place + p] = parent;
        }
    }
}

void push_level(uint fine_first, ivec2 fine_size, uint coarse_first, ivec2 coarse_size) {
    for (int i = int(gl_LocalInvocationID.x); i < fine_size.x * fine_size.y; i += GROUP) {
        ivec2 pixel = ivec2(i % fine_size.x, i / fine_size.x);
        uint place = address(fine_first, fine_size, pixel);
        float validity = scratch[place].w;
        if (validity >= 1.0) continue;
        float guide = scratch[place + LAST].w;
        ivec2 near = pixel >> 1;
        ivec2 far = clamp(near + 2 * (pixel & 1) - 1, ivec2(0), coarse_size - 1);
        uint a = address(coarse_first, coarse_size, near);
        uint b = address(coarse_first, coarse_size, ivec2(far.x, near.y));
        uint c = address(coarse_first, coarse_size, ivec2(near.x, far.y));
        uint d = address(coarse_first, coarse_size, far);
        vec4 share = push_shares(guide, vec4(scratch[a + LAST].w, scratch[b + LAST].w,
                                             scratch[c + LAST].w, scratch[d + LAST].w));
        float keep = kept(validity, gamma);
        for (uint p = 0u; p < PLANES; ++p) {
            vec4 below = mixed(share, scratch[a + p], scratch[b + p], scratch[c + p],
                               scratch[d + p]);
            vec4 texel = keep * scratch[place + p] + (1.0 - keep) * below;
            if (p == 0u) texel.w = validity;
            if (p == LAST) texel.w = guide;
            scratch[place + p] = texel;
        }
    }
}

void wait() {
    memoryBarrierBuffer();
    barrier();
}

void main() {
    load_top();
    wait();
    uint first = 0u;
    ivec2 size = top_size;
    int depth = 0;
    while (size != ivec2(1)) {
        uint next = first + uint(size.x * size.y);
        pull_level(first, size, next, halved(size));
        wait();
        first = next;
        size = halved(size);
        ++depth;
    }
    // Sizes on the way back up follow from the top's: walk down again to each.
    for (int level = depth - 1; level >= 0; --level) {
        uint fine_first = 0u;
        ivec2 fine_size = top_size;
        for (int i = 0; i < level; ++i) {
            fine_first += uint(fine_size.x * fine_size.y);
            fine_size = halved(fine_size);
        }
        push_level(fine_first, fine_size, fine_first + uint(fine_size.x * fine_size.y),
                   halved(fine_size));
        wait();
    }
    int chain = int(gl_WorkGroupID.x);
    for (int i = int(gl_LocalInvocationID.x); i < top_size.x * top_size.y; i += GROUP) {
        ivec2 pixel = ivec2(i % top_size.x, i / top_size.x);
        uint place = address(0u, top_size, pixel);
        for (int p = 0; p < PLANES; ++p) {
            imageStore(top, ivec3(pixel, chain * PLANES + p), scratch[place + uint(p)]);
        }
    }
}
