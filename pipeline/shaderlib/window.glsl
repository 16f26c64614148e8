// A level of the filled frame and its guide, for what makes moments of it.

#constant IS_FINEST  // 1: level 0, whose guide comes from depth
#constant GATED      // 1: a gate tells which coefficients count

layout(rgba32f) uniform readonly image2D level;  // see measure()
#if IS_FINEST
layout(r32f) uniform readonly image2D depth_m;
uniform float z_near_m;
float guide_at(ivec2 place) { return max(0.0, 1.0 - z_near_m / imageLoad(depth_m, place).r); }
#else
layout(r32f) uniform readonly image2D level_guide;
float guide_at(ivec2 place) { return imageLoad(level_guide, place).r; }
#endif

#if GATED
layout(r32f) uniform readonly image2D gate;  // of 4x4 pixels
layout(std140) uniform Gate { int gate_shift; };
float part_at(ivec2 child) { return imageLoad(gate, child >> gate_shift).r; }
#else
float part_at(ivec2 child) { return 1.0; }
#endif
