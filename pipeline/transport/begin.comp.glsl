#version 430
// Forget the last frame's fill; list the first shell, and the known pixels that hole pixels see.
// Twin: shells() in reference.py. Change both or neither.

#constant RADIUS_PX  // hole pixels see so far

#include "pixels.glsl"
#include "transport.glsl"

layout(std430) buffer Listed { uint listed[]; };  // per pixel: 1 where it is on a list, 0 before

uniform uvec2 shell_list;
uniform uvec2 band_list;

bool first_time(ivec2 pixel) {
    return atomicExchange(listed[uint(pixel.y * imageSize(image).x + pixel.x)], 1u) == 0u;
}

// True if there is known colour beside the pixel.
bool begin(ivec2 pixel) {
    if (!is_inside(pixel) || is_known(pixel)) return false;
    float guide = guide_at(pixel);
    imageStore(moved, pixel, vec4(0.0, 0.0, 0.0, guide));
    imageStore(tensors, pixel, vec4(0.0, 0.0, 0.0, UNREACHED));
    if (!is_worked(pixel, RADIUS_PX)) return false;
    bool at_border = false, at_own = false;
    for (int k = 0; k < 8; ++k) {
        ivec2 place = pixel + neighbour(k);
        if (!is_inside(place) || !is_known(place)) continue;
        at_border = true;
        at_own = at_own || is_alike(guide, guide_at(place));
    }
    if (at_own && is_worked(pixel, 0) && first_time(pixel)) append(shell_list.x, shell_list.y, pixel, 0);
    return at_border;
}

// `parent` is a pixel of resolution 1.
void work(ivec2 parent, int chain) {
    bool at_border = false;
    for (int child = 0; child < 4; ++child) {
        if (begin(2 * parent + ivec2(child & 1, child >> 1))) at_border = true;
    }
    // The way from a hole pixel to a known one that it sees leads over a border: it is enough to
    // list what pixels at a border see.
    if (!at_border) return;
    for (int y = -RADIUS_PX; y <= RADIUS_PX + 1; ++y) {
        for (int x = -RADIUS_PX; x <= RADIUS_PX + 1; ++x) {
            ivec2 place = 2 * parent + ivec2(x, y);
            if (is_inside(place) && is_known(place) && first_time(place))
                append(band_list.x, band_list.y, place, 0);
        }
    }
}
