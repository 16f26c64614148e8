#version 430
// Low-pass and halve what is known, by normalised convolution. Twin: half() in reference.py.
// Change both or neither.

#constant TILE       // work-group edge, pixels of the coarser level
#constant LOW_INNER  // taps of the 4x4 kernel: both offsets inner,
#constant LOW_MIXED  // one outer,
#constant LOW_OUTER  // both outer

layout(local_size_x = TILE, local_size_y = TILE) in;

layout(rgba32f) uniform readonly image2D fine;     // Y'CbCr; a: 1 known, 0 hole, or PARTLY
layout(r32f) uniform readonly image2D fine_guide;
layout(rgba32f) uniform writeonly image2D coarse;
layout(r32f) uniform writeonly image2D coarse_guide;

const float PARTLY = -1.0;  // known in part

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(coarse)))) return;
    ivec2 last = imageSize(fine) - 1;
    vec3 sum = vec3(0.0);
    float total = 0.0, farthest = 0.0;
    bool all_known = true, some = false;
    for (int i = 0; i < 4; ++i) {
        for (int j = 0; j < 4; ++j) {
            ivec2 at = clamp(2 * pixel + ivec2(j, i) - 1, ivec2(0), last);
            bool inner_y = i == 1 || i == 2, inner_x = j == 1 || j == 2;
            float tap = inner_y && inner_x ? LOW_INNER : inner_y || inner_x ? LOW_MIXED : LOW_OUTER;
            vec4 texel = imageLoad(fine, at);
            sum += texel.a != 0.0 ? tap * texel.rgb : vec3(0.0);
            total += texel.a != 0.0 ? tap : 0.0;
            if (inner_y && inner_x) {
                all_known = all_known && texel.a == 1.0;
                some = some || texel.a != 0.0;
                farthest = max(farthest, imageLoad(fine_guide, at).x);
            }
        }
    }
    imageStore(coarse, pixel, some ? vec4(sum / total, all_known ? 1.0 : PARTLY) : vec4(0.0));
    imageStore(coarse_guide, pixel, vec4(farthest));
}
