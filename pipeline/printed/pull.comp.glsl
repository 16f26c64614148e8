#version 430
// Pull: average the valid children that are no nearer than the farthest. Twin: pull() in
// inpaint/reference.py. Change both or neither.

#constant TILE     // work-group edge, pixels of the coarser level
#constant COLUMNS  // planes side by side,
#constant ROWS     // and below each other

layout(local_size_x = TILE, local_size_y = TILE) in;

layout(rgba32f) uniform readonly image2D fine;
layout(rg32f) uniform readonly image2D fine_state;  // validity, guide
layout(rgba32f) uniform writeonly image2D coarse;
layout(rg32f) uniform writeonly image2D coarse_state;

uniform float depth_threshold;

const float ONLY_NEARER = -1.0;  // something is known, all of it in front

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    ivec2 size = imageSize(coarse_state), fine_size = imageSize(fine_state);
    if (any(greaterThanEqual(pixel, size))) return;
    ivec2 place[4];
    vec2 state[4];
    float farthest = 0.0;
    for (int k = 0; k < 4; ++k) {
        place[k] = min(2 * pixel + ivec2(k & 1, k >> 1), fine_size - 1);
        state[k] = imageLoad(fine_state, place[k]).xy;
        farthest = max(farthest, state[k].y);
    }
    float total = 0.0, anything = 0.0;
    for (int k = 0; k < 4; ++k) {
        if (state[k].x > 0.0 && farthest - state[k].y <= depth_threshold) total += state[k].x;
        if (state[k].x != 0.0) anything += 1.0;
    }
    float share[4];
    for (int k = 0; k < 4; ++k) {
        bool counts = state[k].x > 0.0 && farthest - state[k].y <= depth_threshold;
        if (total > 0.0) share[k] = counts ? state[k].x / total : 0.0;
        else share[k] = anything > 0.0 && state[k].x != 0.0 ? 1.0 / anything : 0.0;
    }
    for (int row = 0; row < ROWS; ++row)
        for (int column = 0; column < COLUMNS; ++column) {
            ivec2 from = ivec2(column, row) * fine_size;
            vec4 sum = vec4(0.0);
            for (int k = 0; k < 4; ++k) sum += share[k] * imageLoad(fine, from + place[k]);
            imageStore(coarse, ivec2(column, row) * size + pixel, sum);
        }
    float validity = total > 0.0 ? total / 4.0 : anything > 0.0 ? ONLY_NEARER : 0.0;
    imageStore(coarse_state, pixel, vec4(validity, farthest, 0.0, 0.0));
}
