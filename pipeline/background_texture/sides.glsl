// On which side of a hole pixel its background lies: eight rays go to the nearest known pixels, and
// motion tells which end opened the hole.
// Twin: background_border() in background_texture/reference.py. Change both or neither.
//
// The includer declares the images `image` (a: 1 known, 0 hole), `depth_m` and `flow_px` (target
// minus source). Include guided.glsl before.

#constant REACH           // how far a ray looks for a known pixel
#constant MARGIN          // by how much rounding may widen a hole beyond the motion that opened it
#constant OCTANT_TANGENT

uniform float z_near_m;

bool is_inside(ivec2 place) {
    return all(greaterThanEqual(place, ivec2(0))) && all(lessThan(place, imageSize(image)));
}

bool is_hole(ivec2 place) { return imageLoad(image, place).a < 0.5; }

float guide_at(ivec2 place) { return max(0.0, 1.0 - z_near_m / imageLoad(depth_m, place).r); }

bool is_background(ivec2 place, float guide) {
    return is_inside(place) && !is_hole(place) && guide - guide_at(place) <= depth_threshold;
}

vec2 flow_at(ivec2 place) {
    return imageLoad(flow_px, clamp(place, ivec2(0), imageSize(flow_px) - 1)).rg;
}

// Clockwise from the right.
ivec2 octant(int number) {
    int turned = number & 3;
    ivec2 direction = turned == 0 ? ivec2(1, 0) : turned == 1 ? ivec2(1, 1)
                    : turned == 2 ? ivec2(0, 1) : ivec2(-1, 1);
    return (number & 4) == 0 ? direction : -direction;
}

ivec2 octant_of(vec2 vector) {
    vec2 extent = abs(vector);
    return ivec2(sign(vector) * vec2(greaterThan(extent, OCTANT_TANGENT * extent.yx)));
}

// Steps to the first known pixel; 0: none within `reach`.
int steps_to_known(ivec2 pixel, ivec2 direction, int reach) {
    ivec2 place = pixel;
    for (int count = 1; count <= reach; ++count) {
        place += direction;
        if (!is_inside(place)) return 0;
        if (!is_hole(place)) return count;
    }
    return 0;
}

struct Side {
    ivec2 direction;
    int steps;  // to the background's border; 0: there is none, and the direction is the parallax's
};

Side background_side(ivec2 pixel, float guide) {
    // Of opener and background: squared length and number, so that the first of equals wins.
    const ivec2 NONE = ivec2(0x7fffffff, 8);
    ivec2 to_opener = NONE, to_background = NONE;
    ivec2 opener = pixel;
    int reach = REACH;
    for (int turn = 0; turn < 8; ++turn) {
        // Sides before corners, opposites together: the sooner both are met, the less to walk.
        int number = ((turn & 1) << 2) | (turn & 2) | (turn >> 2);
        ivec2 direction = octant(number);
        int steps = steps_to_known(pixel, direction, reach);
        if (steps == 0) continue;
        int squared = steps * steps * (direction.x * direction.x + direction.y * direction.y);
        ivec2 end = pixel + steps * direction;
        bool behind = guide - guide_at(end) <= depth_threshold;
        ivec2 best = behind ? to_background : to_opener;
        if (squared < best.x || (squared == best.x && number < best.y)) {
            if (behind) {
                to_background = ivec2(squared, number);
            } else {
                to_opener = ivec2(squared, number);
                opener = end;
            }
        }
        int farther = max(to_opener.x, to_background.x);
        if (farther != NONE.x) reach = min(reach, int(sqrt(float(farther))) + 1);
    }
    vec2 relative = flow_at(pixel) - flow_at(opener);
    if (to_background == NONE) return Side(octant_of(relative), 0);
    float moved = length(relative);
    bool opened = to_opener != NONE && moved > 0.0 && sqrt(float(to_opener.x)) <= moved + MARGIN;
    Side side;
    side.direction = opened ? octant_of(relative) : octant(to_background.y);
    side.steps = steps_to_known(pixel, side.direction, REACH);
    // The other way, where the background side is another foreground or out of sight.
    if (side.steps == 0 || !is_background(pixel + side.steps * side.direction, guide)) {
        side.direction = -side.direction;
        side.steps = steps_to_known(pixel, side.direction, REACH);
        // Or else the nearest background that there is.
        if (side.steps == 0 || !is_background(pixel + side.steps * side.direction, guide)) {
            side.direction = octant(to_background.y);
            side.steps = steps_to_known(pixel, side.direction, REACH);
        }
    }
    return side;
}
