// Four texels that go into one: 2x2 children into their parent, or four parents into a child.
// Include guided.glsl before.

struct Taps {
    ivec2 a, b, c, d;
};

// Of `near`, of the next ones in x and in y, and in both.
Taps taps_of(ivec2 near, ivec2 far) {
    return Taps(near, ivec2(far.x, near.y), ivec2(near.x, far.y), far);
}

// An odd border repeats its last child.
Taps children_of(ivec2 pixel, ivec2 fine_size) {
    return taps_of(2 * pixel, min(2 * pixel + 1, fine_size - 1));
}

// A pixel's own parent and the next ones on its side.
Taps parents_of(ivec2 pixel, ivec2 coarse_size) {
    ivec2 near = pixel >> 1;
    return taps_of(near, clamp(near + 2 * (pixel & 1) - 1, ivec2(0), coarse_size - 1));
}

#define GUIDES_AT(guide, taps)                                           \
    vec4(imageLoad(guide, taps.a).r, imageLoad(guide, taps.b).r,         \
         imageLoad(guide, taps.c).r, imageLoad(guide, taps.d).r)

#define MIXED_AT(image, taps, share, offset)                                        \
    mixed(share, imageLoad(image, taps.a + offset), imageLoad(image, taps.b + offset), \
          imageLoad(image, taps.c + offset), imageLoad(image, taps.d + offset))
