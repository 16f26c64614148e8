// What the search compares, packed: colour and low-pass by 8 bits, the guide by 15, hole or not.
// Twin: Planes in shiftmap/tiles.py. Change both or neither.

#define ENCODED_STEPS 255.0
#define GUIDE_STEPS 32767.0

ivec3 steps_of(vec3 colour) { return ivec3(roundEven(ENCODED_STEPS * clamp(colour, 0.0, 1.0))); }

int guide_steps_of(float guide) { return int(roundEven(GUIDE_STEPS * clamp(guide, 0.0, 1.0))); }

uint joined(ivec3 colour, int rest) {
    return uint(colour.r | colour.g << 8 | colour.b << 16) | uint(rest) << 24;
}

uvec2 planes_of(ivec3 colour, ivec3 low, int guide, bool hole) {
    return uvec2(joined(colour, guide & 255), joined(low, guide >> 8 | int(hole) << 7));
}

ivec3 unpacked(uint word) { return ivec3(word & 255u, word >> 8 & 255u, word >> 16 & 255u); }

ivec3 colour_in(uvec2 planes) { return unpacked(planes.x); }

ivec3 low_in(uvec2 planes) { return unpacked(planes.y); }

int guide_in(uvec2 planes) { return int(planes.x >> 24 | (planes.y >> 24 & 127u) << 8); }

bool hole_in(uvec2 planes) { return planes.y >> 31 != 0u; }
