#version 430
// The base of every hole pixel: push-pull, and the background's edge averaged across ways side by
// side, or what is nearer where there is no way. What is not thin is cut into tiles.
// Twin: across() and smooth_base() in base.py, cut_tiles() in tiles.py. Change both or neither.

#constant THIN_PX          // across a hole: from here up,
#constant WIDE_PX          // and from here on, it is not thin
#constant EXTENSION_SHARE  // of the base where a hole is not thin
#constant TILES_LIST       // its index,
#constant TILES_FIRST      // and its first entry

#include "pixels.glsl"
#include "shift_tiles.glsl"
#include "shift_planes.glsl"
#include "thickness.glsl"

layout(rgba32f) uniform readonly image2D image;  // a: 1 known, 0 hole
layout(r32f) uniform readonly image2D depth_m;
layout(rg32f) uniform readonly image2D flow_px;
layout(rgba32i) uniform readonly iimage2D ways;
layout(rgba32f) uniform readonly image2D ends;
layout(rgba32f) uniform writeonly image2D base;  // a: how far from thin

uniform float z_near_m;
uniform float depth_threshold;

bool is_hole(ivec2 place) {
    return all(greaterThanEqual(place, ivec2(0))) && all(lessThan(place, imageSize(image)))
        && imageLoad(image, place).a < 0.5;
}

void cut(ivec2 pixel, ivec4 way) {
    ivec2 grid = grid_subpixels(pixel, imageLoad(flow_px, pixel).rg);
    ivec2 place = place_in_grid(grid);
    ivec2 corner = SUBPIXELS * pixel + SUBPIXELS / 2 - (grid - TILE * place);
    int tile = tile_at(place);
    if (atomicAdd(tiles[tile].count, 1) == 0) {
        add(uint(TILES_LIST), uint(TILES_FIRST), entry_of(wrapped(place), 0), 1u);
    }
    atomicAdd(tiles[tile].way_x, way.x);
    atomicAdd(tiles[tile].way_y, way.y);
    atomicMax(tiles[tile].way_px, way.z);
    atomicMax(tiles[tile].across_px, way.w);
    atomicAdd(tiles[tile].corner_x, corner.x);
    atomicAdd(tiles[tile].corner_y, corner.y);
    float guide = max(0.0, 1.0 - z_near_m / imageLoad(depth_m, pixel).r);
    atomicAdd(tiles[tile].guide, guide_steps_of(guide));
}

void complete(ivec2 pixel) {
    ivec4 way = imageLoad(ways, pixel);
    vec3 pushed = imageLoad(image, pixel).rgb;
    float wide = 0.0;
    if (way.z > 0) {
        float guide = imageLoad(ends, pixel).a;
        int reach = way.z / 2;
        vec4 total = vec4(0.0);
        float weight = 0.0;
        for (int k = -reach; k <= reach; ++k) {
            ivec2 place = pixel + k * ivec2(way.y, -way.x);
            if (!is_hole(place)) continue;
            ivec4 there = imageLoad(ways, place);
            vec4 end = imageLoad(ends, place);
            if (there.z == 0 || abs(end.a - guide) > depth_threshold) continue;
            float share = float(reach + 1 - abs(k));
            total += share * vec4(end.rgb, thickness(there.w));
            weight += share;
        }
        total /= weight;  // its own way always counts
        wide = total.a;
        pushed += EXTENSION_SHARE * wide * (total.rgb - pushed);
        if (wide > 0.0) cut(pixel, way);
    } else {
        vec4 nearer = imageLoad(ends, pixel);
        pushed += nearer.a * (nearer.rgb - pushed);
    }
    imageStore(base, pixel, vec4(pushed, wide));
}

// `parent` is a pixel of resolution 1.
void work(ivec2 parent, int chain) {
    for (int child = 0; child < 4; ++child) {
        ivec2 pixel = 2 * parent + ivec2(child & 1, child >> 1);
        if (is_hole(pixel)) complete(pixel);
    }
}
