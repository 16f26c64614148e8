// A plate in the source frame: what was filled there, and at which depth. Whole numbers decide.
// Twin: plate/reference.py. Change both or neither.

#constant SUBPIXELS  // in which motion is taken
#constant STEPS      // of a colour, from 0 to 1
#constant READ_SHARE   // a place counts as kept if more of its bilinear share is
#constant WRITE_SHARE  // a texel is written if more of this share is hole pixels

layout(rgba32f) uniform image2D image;  // a: 1 known, 0 hole
layout(r32f) uniform readonly image2D depth_m;
layout(rg32f) uniform readonly image2D flow_px;
layout(rg32ui) uniform uimage2D plate;   // r + (g << 16), b
layout(r32f) uniform image2D plate_m;    // 0: nothing is kept
layout(std430) buffer Claims { uint claims[]; };  // per texel: the first pixel that wants to write it

uniform ivec2 margin;
uniform float same_surface;  // of the greater depth, what the smaller one has at least

const int WHOLE = SUBPIXELS * SUBPIXELS;  // of bilinear shares
const uint NOBODY = 0xFFFFFFFFu;

bool is_within(ivec2 place, ivec2 size) {
    return all(greaterThanEqual(place, ivec2(0))) && all(lessThan(place, size));
}

bool is_hole(ivec2 pixel) {
    return is_within(pixel, imageSize(image)) && imageLoad(image, pixel).a < 0.5;
}

// Place of a pixel in the plate.
ivec2 place_of(ivec2 pixel) {
    vec2 motion = roundEven(float(SUBPIXELS) * imageLoad(flow_px, pixel).xy);
    return SUBPIXELS * (pixel + margin) - ivec2(motion);
}

ivec2 floored(ivec2 place) { return place >> findMSB(SUBPIXELS); }

ivec2 nearest(ivec2 place) { return floored(place + SUBPIXELS / 2); }

// Bilinear share of `corner` (0 or 1, twice) of the four around a place.
int share_of(ivec2 place, ivec2 corner) {
    ivec2 off = abs(SUBPIXELS * (floored(place) + corner) - place);
    return (SUBPIXELS - off.x) * (SUBPIXELS - off.y);
}

ivec2 corner_of(int k) { return ivec2(k & 1, k >> 1); }

// Share of hole pixels around the centre of the texel nearest to this pixel's place.
int holes_around(ivec2 centre) {
    int total = 0;
    for (int k = 0; k < 4; ++k)
        if (is_hole(floored(centre) + corner_of(k))) total += share_of(centre, corner_of(k));
    return total;
}

uint number_of(ivec2 pixel) { return uint(pixel.y * imageSize(image).x + pixel.x); }

uint texel_number(ivec2 texel) { return uint(texel.y * imageSize(plate_m).x + texel.x); }

// True if the plate keeps a colour of this depth at a place; and that colour.
bool recalled(ivec2 place, float own, out vec3 colour) {
    int total = 0;
    uvec3 summed = uvec3(0u);
    for (int k = 0; k < 4; ++k) {
        ivec2 texel = floored(place) + corner_of(k);
        if (!is_within(texel, imageSize(plate_m))) continue;
        float there = imageLoad(plate_m, texel).x;
        if (there == 0.0 || min(own, there) < same_surface * max(own, there)) continue;
        uvec2 kept = imageLoad(plate, texel).xy;
        int share = share_of(place, corner_of(k));
        total += share;
        summed += uint(share) * uvec3(kept.x & 0xFFFFu, kept.x >> 16, kept.y);
    }
    colour = vec3((summed + uint(total / 2)) / uint(max(total, 1))) / float(STEPS);
    return total > READ_SHARE;
}

// Claim the texel nearest to a hole pixel's place.
void claim(ivec2 pixel, ivec2 place) {
    ivec2 texel = nearest(place);
    if (holes_around(SUBPIXELS * (pixel + texel) - place) > WRITE_SHARE)
        atomicMin(claims[texel_number(texel)], number_of(pixel));
}
