// Texels of chains: PLANES vec4 side by side in an image, validity in the first one's w; one
// chain below the other. Include taps.glsl before.

#constant PLANES

// Texel of a pixel's first plane, in an image of chains that are `rows` high.
ivec2 texel_at(ivec2 pixel, int chain, int rows) {
    return ivec2(PLANES * pixel.x, pixel.y + chain * rows);
}

Taps texels_at(Taps taps, int chain, int rows) {
    return Taps(texel_at(taps.a, chain, rows), texel_at(taps.b, chain, rows),
                texel_at(taps.c, chain, rows), texel_at(taps.d, chain, rows));
}

// Calls step(offset) for all planes but the first. No loop: see guided.glsl.
#if PLANES == 1
#define EACH_OTHER_PLANE(step)
#elif PLANES == 4
#define EACH_OTHER_PLANE(step) step(ivec2(1, 0)) step(ivec2(2, 0)) step(ivec2(3, 0))
#else
#error "write out the planes of this chain"
#endif
