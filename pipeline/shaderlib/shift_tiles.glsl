// The table of tiles: one shift each, by whole pixels.
// Twin: Tiles in shiftmap/tiles.py. Change both or neither.

#constant TILE          // a tile's edge, in parts of a pixel
#constant SUBPIXELS     // in which motion is taken

struct Tile {
    int count;       // hole pixels; 0: no tile
    int way_y;       // sum of their steps to the background
    int way_x;
    int way_px;      // the most steps there
    int corner_y;    // sum of where they see the first pixel, in parts of a pixel
    int corner_x;
    int guide;       // sum
    int across_px;   // how wide the hole is along the way, at most
    ivec2 shift[2];  // x, y; before and after a sweep, in turn
    uint there;      // sums of squared luma: what the base has above a low-pass,
    uint wanted;     // and what is copied
};

layout(std430) buffer Tiles { Tile tiles[]; };

uniform ivec2 table_size;

// Whole numbers divided, towards minus infinity.
int floor_divided(int a, int b) { return a >= 0 ? a / b : -((b - 1 - a) / b); }

// Divided to the nearest one; halves go up.
int rounded(int total, int count) { return floor_divided(2 * total + count, 2 * count); }

ivec2 wrapped(ivec2 place) {
    return place - table_size * ivec2(floor_divided(place.x, table_size.x),
                                      floor_divided(place.y, table_size.y));
}

int tile_at(ivec2 place) {
    ivec2 cell = wrapped(place);
    return cell.y * table_size.x + cell.x;
}

// Where a pixel's centre lies in the grid of tiles, in parts of a pixel.
ivec2 grid_subpixels(ivec2 pixel, vec2 flow) {
    return SUBPIXELS * pixel + SUBPIXELS / 2 - ivec2(roundEven(float(SUBPIXELS) * flow));
}

ivec2 place_in_grid(ivec2 grid) {
    return ivec2(floor_divided(grid.x, TILE), floor_divided(grid.y, TILE));
}
