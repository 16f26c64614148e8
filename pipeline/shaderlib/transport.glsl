// Surroundings of a hole's pixels, for coherence transport.
// Twin: transport/reference.py. Change both or neither.

layout(rgba32f) uniform readonly image2D image;  // rgb: encoded; a: 1 known, 0 hole
layout(r32f) uniform readonly image2D depth_m;   // background's inside holes
// Of hole pixels, and of the known ones that they see:
layout(rgba32f) uniform image2D moved;    // colour as far as it is known; a: guide
layout(rgba32f) uniform image2D tensors;  // xx, xy, yy; a: shell, 0 where known

uniform float depth_threshold;
uniform float z_near_m;
uniform ivec2 low, high;  // corners of where transport works; the end is not in it

const float UNREACHED = 1e9;

bool is_inside(ivec2 place) {
    return all(greaterThanEqual(place, ivec2(0))) && all(lessThan(place, imageSize(image)));
}

bool is_worked(ivec2 place, int beyond_px) {
    return all(greaterThanEqual(place, low - beyond_px)) && all(lessThan(place, high + beyond_px));
}

bool is_known(ivec2 place) { return imageLoad(image, place).a >= 0.5; }

float guide_at(ivec2 place) { return max(0.0, 1.0 - z_near_m / imageLoad(depth_m, place).r); }

bool is_alike(float guide, float other) { return abs(guide - other) <= depth_threshold; }

// True if a step leads to another pixel within a radius.
bool in_disc(ivec2 along, int radius_px) {
    int squared = along.x * along.x + along.y * along.y;
    return squared > 0 && squared <= radius_px * radius_px;
}

// Clockwise from the right: the sides, then the corners.
ivec2 neighbour(int number) {
    int turned = number & 3;
    ivec2 side = turned == 0 ? ivec2(1, 0) : turned == 1 ? ivec2(0, 1)
               : turned == 2 ? ivec2(-1, 0) : ivec2(0, -1);
    return number < 4 ? side : side + ivec2(-side.y, side.x);
}
