#version 430
// First pull of one level's band moments: coefficients are made, checked and averaged here,
// 2x2 into one, and never stored.
// Twin: band_statistics() and outlined_levels() in reference.py. Change both or neither.

#constant IS_FINEST         // 1: level 0, whose guide comes from depth
#constant CROSS             // 1: second moments are products with luma, else squares
#constant SKIP_DEPTH_EDGES  // 1: a kernel across a jump of depth measures nothing
#constant PLANES

#include "tiles.glsl"
#include "guided.glsl"
#include "bands.glsl"

// rgb: filled; a: 1 clean, 0 reached by a hole, below that mixed from two depths
layout(rgba32f, binding = 0) uniform readonly image2D level;
layout(std430, binding = 4) writeonly buffer Moments { vec4 moments[]; };
layout(std430, binding = 5) writeonly buffer Lacking { vec4 variances[]; };  // see lacking.comp.glsl
layout(std430, binding = 6) readonly buffer CoarseGuide { float coarse_guide[]; };
#if IS_FINEST
layout(r32f, binding = 1) uniform readonly image2D depth_m;
uniform float z_near_m;
#define GUIDE_AT(place) max(0.0, 1.0 - z_near_m / imageLoad(depth_m, place).r)
#else
layout(std430, binding = 7) readonly buffer LevelGuide { float level_guide[]; };
#define GUIDE_AT(place) level_guide[(place).y * size.x + (place).x]
#endif

uniform int chain;
uniform int first_texel;        // of this level's variances
uniform uvec2 incomplete_list;  // index and first entry: what push has to complete

// Smallest (x) and largest (y) guide of three neighbours in a row.
vec2 extent(float a, float b, float c) { return vec2(min(min(a, b), c), max(max(a, b), c)); }

float least(vec3 v) { return min(min(v.x, v.y), v.z); }

bool jumps(vec2 above, vec2 here, vec2 below, float centre) {
    vec2 all = vec2(min(min(above.x, here.x), below.x), max(max(above.y, here.y), below.y));
    return max(centre - all.x, all.y - centre) > depth_threshold;
}

vec3 second_moment(vec3 band) { return band * (CROSS == 1 ? band.xxx : band); }

void work(ivec2 pixel) {
    ivec2 size = imageSize(level);
    FETCH_WINDOW(level, pixel, size)
    bvec2 whole = lessThan(inner_ + 1, size);  // an odd border has no second child

    // Clean of holes, row by row for the left and the right children.
    vec4 left = vec4(least(vec3(window_00.a, window_01.a, window_02.a)),
                     least(vec3(window_10.a, window_11.a, window_12.a)),
                     least(vec3(window_20.a, window_21.a, window_22.a)),
                     least(vec3(window_30.a, window_31.a, window_32.a)));
    vec4 right = vec4(least(vec3(window_01.a, window_02.a, window_03.a)),
                      least(vec3(window_11.a, window_12.a, window_13.a)),
                      least(vec3(window_21.a, window_22.a, window_23.a)),
                      least(vec3(window_31.a, window_32.a, window_33.a)));
    vec4 valid = step(0.5, vec4(least(left.xyz), least(right.xyz), least(left.yzw), least(right.yzw)));

    vec4 guide = vec4(GUIDE_AT(inner_), GUIDE_AT(ivec2(next_.x, inner_.y)),
                      GUIDE_AT(ivec2(inner_.x, next_.y)), GUIDE_AT(next_));
    bool outlined = false;  // whether one of the four is across a jump of depth
#if SKIP_DEPTH_EDGES
    vec4 top = vec4(GUIDE_AT(ivec2(x_.x, y_.x)), GUIDE_AT(ivec2(inner_.x, y_.x)),
                    GUIDE_AT(ivec2(next_.x, y_.x)), GUIDE_AT(ivec2(x_.y, y_.x)));
    vec4 bottom = vec4(GUIDE_AT(ivec2(x_.x, y_.y)), GUIDE_AT(ivec2(inner_.x, y_.y)),
                       GUIDE_AT(ivec2(next_.x, y_.y)), GUIDE_AT(ivec2(x_.y, y_.y)));
    vec2 west = vec2(GUIDE_AT(ivec2(x_.x, inner_.y)), GUIDE_AT(ivec2(x_.x, next_.y)));
    vec2 east = vec2(GUIDE_AT(ivec2(x_.y, inner_.y)), GUIDE_AT(ivec2(x_.y, next_.y)));
    vec2 left_0 = extent(top.x, top.y, top.z), right_0 = extent(top.y, top.z, top.w);
    vec2 left_1 = extent(west.x, guide.x, guide.y), right_1 = extent(guide.x, guide.y, east.x);
    vec2 left_2 = extent(west.y, guide.z, guide.w), right_2 = extent(guide.z, guide.w, east.y);
    vec2 left_3 = extent(bottom.x, bottom.y, bottom.z);
    vec2 right_3 = extent(bottom.y, bottom.z, bottom.w);
    vec4 across = vec4(jumps(left_0, left_1, left_2, guide.x),
                       jumps(right_0, right_1, right_2, guide.y),
                       jumps(left_1, left_2, left_3, guide.z),
                       jumps(right_1, right_2, right_3, guide.w));
    valid *= 1.0 - across;
    vec4 both = min(left, right);
    outlined = across != vec4(0.0) || min(least(both.xyz), both.w) < -0.5;
#endif
    // The first child stands for one that is not there.
    if (!whole.x) valid.yw = valid.xz;
    if (!whole.y) valid.zw = valid.xy;

    int place = pixel.y * work_size.x + pixel.x;
    Pull p = pull_shares(valid, guide, coarse_guide[place]);

    BANDS_OF_CHILDREN(whole)

#define MEAN(name) \
    (p.share.x * a.name + p.share.y * b.name + p.share.z * c.name + p.share.w * d.name)
#define SECOND(name)                                                              \
    (p.share.x * second_moment(a.name) + p.share.y * second_moment(b.name)        \
     + p.share.z * second_moment(c.name) + p.share.w * second_moment(d.name))
    vec3 second = SECOND(high);
    if (p.confidence < 1.0) {
        append(incomplete_list.x, incomplete_list.y, pixel);
        variances[3 * (first_texel + place) + 2].w = outlined ? 1.0 : 0.0;
    }
    int to = (chain * work_size.x * work_size.y + place) * PLANES;
    moments[to] = vec4(MEAN(high), p.confidence);
    moments[to + 1] = vec4(MEAN(along_x), second.x);
    moments[to + 2] = vec4(MEAN(along_y), second.y);
    moments[to + 3] = vec4(SECOND(along_x), second.z);
    moments[to + 4] = vec4(SECOND(along_y), 0.0);
}
