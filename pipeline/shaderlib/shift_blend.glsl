// The four tiles around a pixel.
// Twin: blend_of() in shiftmap/tiles.py. Change both or neither.

#include "shift_tiles.glsl"

struct Blend {
    int own;         // the tile that the pixel lies in
    int a, b, c, d;  // the first, the next in x, in y, in both
    vec4 share;      // of each, bilinear
};

Blend blend_of(ivec2 grid) {
    ivec2 first = place_in_grid(grid - TILE / 2);
    vec2 part = vec2(grid - TILE / 2 - TILE * first) / float(TILE), rest = 1.0 - part;
    return Blend(tile_at(place_in_grid(grid)), tile_at(first), tile_at(first + ivec2(1, 0)),
                 tile_at(first + ivec2(0, 1)), tile_at(first + 1),
                 vec4(rest.x * rest.y, part.x * rest.y, rest.x * part.y, part.x * part.y));
}
