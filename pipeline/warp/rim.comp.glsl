#version 430
// Make hole of the background's pixels along holes: one dispatch marks them, a second clears what
// is marked, so that every pixel is judged by the holes as they were. Two programs: llvmpipe does
// the work of both sides of a branch.
// Twin: without_rim() in speckle.py. Change both or neither.

#constant TILE         // work-group edge, pixels
#constant CLEAR        // whether to clear what is marked, or to mark
#constant RIM_PX       // how deep the rim is, 1 to 4
#constant ALIKE_PX     // what moves as a hole does to so many pixels is what the hole uncovered

layout(local_size_x = TILE, local_size_y = TILE) in;

// NOTHING, as the last stage left them; RIM between the two dispatches.
layout(std430) buffer Ranks { uvec2 ranks[]; };  // x: the key

layout(rgba32f) uniform image2D warped_colour;  // a: 1 known, 0 hole
layout(rg32f) uniform readonly image2D warped_flow_px;

const uint NOTHING = 0xFFFFFFFFu;
const uint RIM = 0u;

bool hole_at(ivec2 pixel) {
    return all(greaterThanEqual(pixel, ivec2(0)))
        && all(lessThan(pixel, imageSize(warped_colour)))
        && imageLoad(warped_colour, pixel).a == 0.0;
}

// True if at most RIM_PX steps `along` lead into three hole pixels in line, the first of which
// moves as `motion`. No loop: see guided.glsl.
bool rim_along(ivec2 pixel, ivec2 along, vec2 motion) {
    ivec2 first = pixel + along;
    bool found = hole_at(first);
#if RIM_PX > 1
    if (!found) { first += along; found = hole_at(first); }
#endif
#if RIM_PX > 2
    if (!found) { first += along; found = hole_at(first); }
#endif
#if RIM_PX > 3
    if (!found) { first += along; found = hole_at(first); }
#endif
    return found && hole_at(first + along) && hole_at(first + 2 * along)
        && all(lessThanEqual(abs(motion - imageLoad(warped_flow_px, first).xy), vec2(ALIKE_PX)));
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    ivec2 size = imageSize(warped_colour);
    if (any(greaterThanEqual(pixel, size))) return;
    int cell = pixel.y * size.x + pixel.x;
#if CLEAR
    if (ranks[cell].x == NOTHING) return;
    ranks[cell].x = NOTHING;
    imageStore(warped_colour, pixel, vec4(0.0));
#else
    if (hole_at(pixel)) return;
    vec2 motion = imageLoad(warped_flow_px, pixel).xy;
    if (rim_along(pixel, ivec2(-1, 0), motion) || rim_along(pixel, ivec2(1, 0), motion)
        || rim_along(pixel, ivec2(0, -1), motion) || rim_along(pixel, ivec2(0, 1), motion)
        || rim_along(pixel, ivec2(-1, -1), motion) || rim_along(pixel, ivec2(1, -1), motion)
        || rim_along(pixel, ivec2(-1, 1), motion) || rim_along(pixel, ivec2(1, 1), motion))
        ranks[cell].x = RIM;
#endif
}
