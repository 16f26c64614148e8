// Visit the tiles of a list. Include it, write
//     void work(ivec2 pixel, int chain)
// and the main() below calls it for every pixel of every listed tile, borders excepted.

#constant TILE  // a tile's edge, pixels: 8, or 4 where one work group takes four tiles

#include "lists.glsl"

layout(local_size_x = LIST_GROUP) in;

#define TILE_PIXELS (TILE * TILE)
#define TILES (LIST_GROUP / TILE_PIXELS)

layout(std140) uniform Visit {
    uint list_index;
    uint list_first;
    ivec2 work_size;  // pixels of the resolution that the tiles divide
};

void work(ivec2 pixel, int chain);

void main() {
    int index = int(gl_LocalInvocationID.x);
    uint item = group_at_hand() * uint(TILES);
    if (TILES > 1) item += uint(index / TILE_PIXELS);
    if (item >= entries_in(list_index)) return;
    uint entry = entries[list_first + item];
    ivec2 pixel = TILE * place_of(entry) + ivec2(index % TILE, index % TILE_PIXELS / TILE);
    if (all(lessThan(pixel, work_size))) work(pixel, chain_of(entry));
}
