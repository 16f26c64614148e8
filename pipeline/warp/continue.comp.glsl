#version 430
// Continue depth and motion into pixels that no quad reached, along rows or along columns:
// each run takes the farther of its two ends. Such pixels are rare (quads behind the camera),
// so one invocation walks a whole line, and all leave at once where there are none.
// Twin: continued() in reference.py. Change both or neither.

#constant LANES  // work-group size

layout(local_size_x = LANES) in;

layout(std430) buffer Lists {
    uint counts[2];
    uint left_count;
    uint unreached;
};

layout(r32f) uniform image2D warped_depth_m;   // 0: not reached
layout(rg32f) uniform image2D warped_flow_px;

uniform ivec2 along;     // (1, 0) for rows, then (0, 1) for columns
uniform float fallback;  // depth of a line that nothing reached

void main() {
    // Nothing to do is zero lines and zero cells: llvmpipe walks masked loops to their end.
    bool needed = unreached != 0u;
    ivec2 size = imageSize(warped_depth_m);
    ivec2 across = along.yx;
    int line = int(gl_GlobalInvocationID.x);
    int lines = !needed ? 0 : along.x == 1 ? size.y : size.x;
    int cells = !needed ? -1 : along.x == 1 ? size.x : size.y;
    if (line >= lines) return;

    ivec2 origin = across * line;
    int end = -1;  // the last known cell before the run
    for (int cell = 0; cell <= cells; ++cell) {
        bool known = cell < cells && imageLoad(warped_depth_m, origin + along * cell).x > 0.0;
        if (cell < cells && !known) continue;
        if (cell - end > 1) {
            float before = end < 0 ? 0.0 : imageLoad(warped_depth_m, origin + along * end).x;
            float after = cell == cells ? 0.0 : imageLoad(warped_depth_m, origin + along * cell).x;
            vec4 depth = vec4(max(before, after));
            vec4 motion = vec4(0.0);
            if (depth.x == 0.0) depth = vec4(fallback);
            else motion = imageLoad(warped_flow_px, origin + along * (before >= after ? end : cell));
            for (int gap = end + 1; gap < cell; ++gap) {
                imageStore(warped_depth_m, origin + along * gap, depth);
                imageStore(warped_flow_px, origin + along * gap, motion);
            }
        }
        end = cell;
    }
}
