#version 430
// Tail: the last resolutions, down to 1x1 and back, in one work group per chain.
// A dispatch for each would cost more than its few texels.
// Twin: pull_push() in reference.py. Change both or neither.

#constant GROUP         // work-group size
#constant MOST_CHAINS
#constant CHAIN_TEXELS  // of all resolutions here together
#constant RELAXED       // so many of the finest ones are relaxed
#constant GAMMA         // how much of itself an incomplete texel keeps, see kept()

#include "active.glsl"
#include "guided.glsl"
#include "taps.glsl"
#include "planes.glsl"

layout(local_size_x = GROUP) in;

layout(rgba32f) uniform image2D top;
layout(r32f) uniform readonly image2D top_guide;
#if PLANES == 1  // a work group shares 32 KiB
const int FIRST = 0;
shared vec4 scratch[CHAIN_TEXELS];
shared float scratch_guide[CHAIN_TEXELS];
#else
#define FIRST int(gl_WorkGroupID.x) * CHAIN_TEXELS
layout(std430) coherent buffer Scratch { vec4 scratch[]; };
layout(std430) coherent buffer ScratchGuide { float scratch_guide[]; };
#endif

layout(std140) uniform Step {
    ivec2 top_size;
    uvec3 guide_region;             // active tiles of the guide
    uvec3 top_region[MOST_CHAINS];  // active tiles of each chain
};

int scratch_at(int first, ivec2 size, ivec2 pixel) {
    return FIRST + first + pixel.y * size.x + pixel.x;
}

ivec2 halved(ivec2 size) { return (size + 1) >> 1; }

void load_top() {
    int chain = int(gl_WorkGroupID.x);
    int count = top_size.x * top_size.y;
    for (int i = int(gl_LocalInvocationID.x); i < count; i += GROUP) {
        ivec2 pixel = ivec2(i % top_size.x, i / top_size.x);
        int place = scratch_at(0, top_size, pixel);
        ivec2 from = texel_at(pixel, chain, top_size.y);
        bool known = is_active(top_region[chain], pixel);
        for (int p = 0; p < PLANES; ++p) {
            scratch[place * PLANES + p] = known ? imageLoad(top, from + ivec2(p, 0)) : vec4(0.0);
        }
        scratch_guide[place] = is_active(guide_region, pixel) ? imageLoad(top_guide, pixel).r : 0.0;
    }
}

void pull_level(int fine_first, ivec2 fine_size, int coarse_first, ivec2 coarse_size) {
    for (int i = int(gl_LocalInvocationID.x); i < coarse_size.x * coarse_size.y; i += GROUP) {
        ivec2 pixel = ivec2(i % coarse_size.x, i / coarse_size.x);
        ivec2 near = 2 * pixel;
        ivec2 far = min(near + 1, fine_size - 1);
        int a = scratch_at(fine_first, fine_size, near);
        int b = scratch_at(fine_first, fine_size, ivec2(far.x, near.y));
        int c = scratch_at(fine_first, fine_size, ivec2(near.x, far.y));
        int d = scratch_at(fine_first, fine_size, far);
        vec4 validity = vec4(scratch[a * PLANES].w, scratch[b * PLANES].w, scratch[c * PLANES].w,
                             scratch[d * PLANES].w);
        vec4 guide =
            vec4(scratch_guide[a], scratch_guide[b], scratch_guide[c], scratch_guide[d]);
        float deepest = farthest(guide);
        Pull pulled = pull_shares(validity, guide, deepest);
        int place = scratch_at(coarse_first, coarse_size, pixel);
        for (int p = 0; p < PLANES; ++p) {
            vec4 parent = mixed(pulled.share, scratch[a * PLANES + p], scratch[b * PLANES + p],
                                scratch[c * PLANES + p], scratch[d * PLANES + p]);
            if (p == 0) parent.w = pulled.confidence;
            scratch[place * PLANES + p] = parent;
        }
        scratch_guide[place] = deepest;
    }
}

void push_level(int fine_first, ivec2 fine_size, int coarse_first, ivec2 coarse_size) {
    for (int i = int(gl_LocalInvocationID.x); i < fine_size.x * fine_size.y; i += GROUP) {
        ivec2 pixel = ivec2(i % fine_size.x, i / fine_size.x);
        int place = scratch_at(fine_first, fine_size, pixel);
        float validity = scratch[place * PLANES].w;
        if (validity >= 1.0) continue;
        ivec2 near = pixel >> 1;
        ivec2 far = clamp(near + 2 * (pixel & 1) - 1, ivec2(0), coarse_size - 1);
        int a = scratch_at(coarse_first, coarse_size, near);
        int b = scratch_at(coarse_first, coarse_size, ivec2(far.x, near.y));
        int c = scratch_at(coarse_first, coarse_size, ivec2(near.x, far.y));
        int d = scratch_at(coarse_first, coarse_size, far);
        Shares below_by =
            push_shares(scratch_guide[place], vec4(scratch_guide[a], scratch_guide[b],
                                                   scratch_guide[c], scratch_guide[d]));
        float keep = kept(validity, GAMMA, below_by.similar);
        for (int p = 0; p < PLANES; ++p) {
            vec4 below = mixed(below_by.share, scratch[a * PLANES + p], scratch[b * PLANES + p],
                               scratch[c * PLANES + p], scratch[d * PLANES + p]);
            vec4 texel = keep * scratch[place * PLANES + p] + (1.0 - keep) * below;
            if (p == 0) texel.w = validity;
            scratch[place * PLANES + p] = texel;
        }
    }
}

#if RELAXED > 0
#if PLANES != 1
#error "a relaxation takes a texel to be one vec4"
#endif
// Twin: relax() in reference.py; see relax.comp.glsl.
void relax_level(int first, ivec2 size, int parity) {
    for (int i = int(gl_LocalInvocationID.x); i < size.x * size.y; i += GROUP) {
        ivec2 pixel = ivec2(i % size.x, i / size.x);
        if (((pixel.x + pixel.y) & 1) != parity) continue;
        int place = scratch_at(first, size, pixel);
        vec4 own = scratch[place];
        if (own.w >= 1.0) continue;
        ivec2 before = max(pixel - 1, ivec2(0)), after = min(pixel + 1, size - 1);
        int left = scratch_at(first, size, ivec2(before.x, pixel.y));
        int right = scratch_at(first, size, ivec2(after.x, pixel.y));
        int above = scratch_at(first, size, ivec2(pixel.x, before.y));
        int below = scratch_at(first, size, ivec2(pixel.x, after.y));
        vec4 guides = vec4(scratch_guide[left], scratch_guide[right], scratch_guide[above],
                           scratch_guide[below]);
        vec4 share = relax_shares(scratch_guide[place], guides);
        if (share == vec4(0.0)) continue;
        vec3 mean = mixed(share, scratch[left], scratch[right], scratch[above],
                          scratch[below]).rgb;
        float keep = kept(own.w, GAMMA, true);
        scratch[place] = vec4(keep * own.rgb + (1.0 - keep) * mean, own.w);
    }
}
#endif

void wait() {
    memoryBarrierBuffer();
    barrier();
}

void main() {
    load_top();
    wait();
    int first = 0;
    ivec2 size = top_size;
    int depth = 0;
    while (size != ivec2(1)) {
        int next = first + size.x * size.y;
        pull_level(first, size, next, halved(size));
        wait();
        first = next;
        size = halved(size);
        ++depth;
    }
    // Sizes on the way back follow from the top's: walk down again to each.
    for (int level = depth - 1; level >= 0; --level) {
        int fine_first = 0;
        ivec2 fine_size = top_size;
        for (int i = 0; i < level; ++i) {
            fine_first += fine_size.x * fine_size.y;
            fine_size = halved(fine_size);
        }
        push_level(fine_first, fine_size, fine_first + fine_size.x * fine_size.y,
                   halved(fine_size));
        wait();
#if RELAXED > 0
        if (level < RELAXED) {
            relax_level(fine_first, fine_size, 0);
            wait();
            relax_level(fine_first, fine_size, 1);
            wait();
        }
#endif
    }
    int chain = int(gl_WorkGroupID.x);
    int count = top_size.x * top_size.y;
    for (int i = int(gl_LocalInvocationID.x); i < count; i += GROUP) {
        int place = FIRST + i;
        ivec2 to = texel_at(ivec2(i % top_size.x, i / top_size.x), chain, top_size.y);
        for (int p = 0; p < PLANES; ++p) {
            imageStore(top, to + ivec2(p, 0), scratch[place * PLANES + p]);
        }
    }
}
