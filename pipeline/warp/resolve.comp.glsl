#version 430
// Show at every target pixel what its winning triangle carries, and clear the ranks for the
// next call. Two programs: the second does what the first leaves to it, wide triangles and those of
// parts, which few pixels show; so the first is short and needs no double.
// Twin: resolve() in reference.py. Change both or neither.

#constant GROUP   // work-group size, pixels in a row
#constant EXTEND  // whether unreached pixels are continued afterwards
#constant LEFT    // whether to do what the first program left

layout(local_size_x = GROUP) in;

#include "warp_mesh.glsl"
#include "warp_rank.glsl"

layout(rgba32f) uniform readonly image2D colour;  // encoded R'G'B', source

// rgb: encoded colour, 0 in holes. a: 1 known, 0 hole.
layout(rgba32f) uniform writeonly image2D warped_colour;
// Metres; in holes the background's. 0 where no quad reached: continue.comp.glsl fills it.
layout(r32f) uniform writeonly image2D warped_depth_m;
layout(rg32f) uniform writeonly image2D warped_flow_px;

// Colour of a pixel: a hole that nothing reached, until told otherwise.
vec4 shown = vec4(0.0);
float depth = bool(EXTEND) ? 0.0 : INFINITE;
vec2 motion = vec2(0.0);

void store(ivec2 pixel) {
    imageStore(warped_colour, pixel, shown);
    imageStore(warped_depth_m, pixel, vec4(depth));
    imageStore(warped_flow_px, pixel, vec4(motion, 0.0, 0.0));
}

void take_if_farther(float there, vec2 motion_there) {
    if (there <= depth) return;
    depth = there;
    motion = motion_there;
}

// 1 / depth is linear in the image plane. This form gives back one depth of three exactly
// where it alone counts, and where all three are the same.
float blend_depth(vec3 metres, vec2 weight) {
    float a = metres.x, b = metres.y, c = metres.z;
    if (weight == vec2(0.0)) return a;
    if (isinf(a)) {
        float inverse = weight.x / b + weight.y / c;
        return inverse > 0.0 ? 1.0 / inverse : INFINITE;
    }
    float ratio = 1.0 + weight.x * (a / b - 1.0) + weight.y * (a / c - 1.0);
    return ratio > 0.0 ? a / ratio : INFINITE;
}

// Three source pixels, their motion, and how the second and third of them weigh.
void show(ivec2 p, ivec2 q, ivec2 r, vec2 fp, vec2 fq, vec2 fr, vec3 metres, vec2 weight) {
    vec3 base = imageLoad(colour, p).rgb;
    vec3 mixed = base + weight.x * (imageLoad(colour, q).rgb - base)
                      + weight.y * (imageLoad(colour, r).rgb - base);
    shown = vec4(clamp(mixed, 0.0, 1.0), 1.0);
    motion = fp + weight.x * (fq - fp) + weight.y * (fr - fp);
    depth = blend_depth(metres, weight);
}

// Weights of the second and third corner of a triangle at the origin; see Areas.
vec2 narrow_weight(ivec2 p, ivec2 q, ivec2 r) {
    int pq = turn(p, q), qr = turn(q, r), pr = turn(p, r);
    return vec2(-float(pr), float(pq)) / float(pq + qr - pr);
}

vec2 wide_weight(dvec2 p, dvec2 q, dvec2 r) {
    double pq = turn(p, q), qr = turn(q, r), pr = turn(p, r);
    return vec2(-float(pr), float(pq)) / float(pq + qr - pr);
}

#if LEFT

void show_left(ivec2 pixel) {
    int cell = cell_of(pixel);
    uint claim = ranks[cell].claim & ~FIRST;
    bool upper = (claim & 1u) == 0u;
    ivec2 mesh = mesh_size();
    uint quads = uint(mesh.x * mesh.y);
    int part = int((claim >> 1) / quads);
    ivec2 first = place_of(int((claim >> 1) - uint(part) * quads), mesh.x);
    Quad quad = load_quad(first, part);
    int second = upper ? 1 : 2;
    ivec2 centre = pixel * SUB + SUB / 2;
    vec2 weight = wide_weight(quad.a - centre, (upper ? quad.b : quad.c) - centre,
                              (upper ? quad.c : quad.d) - centre);
    show(pixel_of(first + corner(source_of(part, 0))),
         pixel_of(first + corner(source_of(part, second))),
         pixel_of(first + corner(source_of(part, second + 1))),
         quad.fa, upper ? quad.fb : quad.fc, upper ? quad.fc : quad.fd,
         upper ? quad.depth.xyz : quad.depth.xzw, weight);
    store(pixel);
}

void main() {
    uint stride = gl_NumWorkGroups.x * GROUP;
    for (uint slot = gl_GlobalInvocationID.x; slot < left_count; slot += stride)
        show_left(place_of(int(entries[slot]), target_size.x));
}

#else

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, target_size))) return;
    int cell = cell_of(pixel);
    uint key = ranks[cell].key;
    uint claim = ranks[cell].claim & ~FIRST;
    ranks[cell].key = NOTHING;

    ivec2 mesh = mesh_size();
    bool own = (claim >> 1) < uint(mesh.x * mesh.y);  // not of a strip or another part
    bool upper = (claim & 1u) == 0u;
    ivec2 vp = place_of(int(claim >> 1), mesh.x);
    ivec2 vq = vp + (upper ? ivec2(1, 0) : ivec2(1)), vr = vp + (upper ? ivec2(1) : ivec2(0, 1));
    ivec2 p = pixel_of(vp), q = pixel_of(vq), r = pixel_of(vr);
    vec2 fp = imageLoad(flow_px, p).xy, fq = imageLoad(flow_px, q).xy, fr = imageLoad(flow_px, r).xy;
    vec3 metres = vec3(imageLoad(depth_m, p).x, imageLoad(depth_m, q).x, imageLoad(depth_m, r).x);
    if (key == NOTHING) {
        if (bool(EXTEND)) unreached = 1u;
    } else if (key >= STRETCHED) {
        // In holes the farthest corner's; the first of equals, in reading order.
        ivec2 s = pixel_of(vp + (upper ? ivec2(0, 1) : ivec2(1, 0)));
        vec2 fs = imageLoad(flow_px, s).xy;
        float beyond = imageLoad(depth_m, s).x;
        depth = metres.x;
        motion = fp;
        take_if_farther(upper ? metres.y : beyond, upper ? fq : fs);    // b
        take_if_farther(upper ? beyond : metres.z, upper ? fs : fr);    // d
        take_if_farther(upper ? metres.z : metres.y, upper ? fr : fq);  // c
    } else {
        ivec2 centre = pixel * SUB + SUB / 2;
        ivec2 to_p = position(vp, fp) - centre;
        ivec2 to_q = position(vq, fq) - centre, to_r = position(vr, fr) - centre;
        if (!own || max(longest(to_p), max(longest(to_q), longest(to_r))) > NARROW) {
            entries[atomicAdd(left_count, 1u)] = uint(cell);
            return;
        }
        show(p, q, r, fp, fq, fr, metres, narrow_weight(to_p, to_q, to_r));
    }
    store(pixel);
}

#endif
