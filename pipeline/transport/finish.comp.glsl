#version 430
// Mix transport into push-pull's fill; where no shell came, some of what is near.
// Twin: transport_fill(), near_around() and across_px() in reference.py. Change both or neither.

#constant RADIUS_PX
#constant NEAR_SHARE
#constant THIN_PX
#constant WIDE_PX
#constant FOVEATED  // 1: transport fills near the gaze alone

#include "pixels.glsl"
#include "transport.glsl"

layout(std430) buffer Listed { uint listed[]; };
layout(rgba32f) uniform image2D filled;  // `image`: push-pull's fill, alpha still 0

uniform float share;
#if FOVEATED
layout(r32f) uniform readonly image2D attention;  // share of transport that the gaze leaves
#endif

// Hole pixels that come next in a direction, fewer than WIDE_PX.
int holes_along(ivec2 pixel, ivec2 along) {
    int count = 0;
    while (count < WIDE_PX - 1) {
        ivec2 place = pixel + (count + 1) * along;
        if (!is_inside(place) || is_known(place)) break;
        ++count;
    }
    return count;
}

float near_share(ivec2 pixel) {
    int row = holes_along(pixel, ivec2(1, 0)) + holes_along(pixel, ivec2(-1, 0));
    int column = holes_along(pixel, ivec2(0, 1)) + holes_along(pixel, ivec2(0, -1));
    float thin = float(WIDE_PX - 1 - min(row, column)) / float(WIDE_PX - THIN_PX);
    return NEAR_SHARE * clamp(thin, 0.0, 1.0);
}

vec4 near_around(ivec2 pixel) {
    vec4 total = vec4(0.0);
    for (int y = -RADIUS_PX; y <= RADIUS_PX; ++y) {
        for (int x = -RADIUS_PX; x <= RADIUS_PX; ++x) {
            ivec2 along = ivec2(x, y), place = pixel + along;
            if (!in_disc(along, RADIUS_PX) || !is_inside(place) || !is_known(place)) continue;
            total += vec4(imageLoad(image, place).rgb, 1.0) / float(x * x + y * y);
        }
    }
    return total;
}

void finish(ivec2 pixel) {
    listed[uint(pixel.y * imageSize(image).x + pixel.x)] = 0u;
    vec3 colour = imageLoad(filled, pixel).rgb, other = imageLoad(moved, pixel).rgb;
    float mixed = share, part = 1.0;
#if FOVEATED
    part = imageLoad(attention, pixel).r;
#endif
    if (part > 0.0 && imageLoad(tensors, pixel).a >= UNREACHED) {
        vec4 around = near_around(pixel);
        mixed = around.a > 0.0 ? near_share(pixel) : 0.0;
        other = around.rgb / max(around.a, 1e-9);
    }
    colour += part * mixed * (other - colour);
    imageStore(filled, pixel, vec4(clamp(colour, 0.0, 1.0), 0.0));
}

// `parent` is a pixel of resolution 1.
void work(ivec2 parent, int chain) {
    for (int child = 0; child < 4; ++child) {
        ivec2 pixel = 2 * parent + ivec2(child & 1, child >> 1);
        if (is_inside(pixel) && !is_known(pixel)) finish(pixel);
    }
}
