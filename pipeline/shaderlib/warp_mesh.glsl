// The mesh that the warp draws: one quad between every four neighbouring vertices.
// Twin: moved_vertices() and coverage() in warp/reference.py.
//
// Vertices are the source pixels and two more rings around them. Ring 1 ends the border
// pixels' own footprint, half a pixel out. Ring 0 lies beyond the target's edge: its quads
// carry the border's depth into what enters the view.
//
// Positions are integers in sub-pixels, so coverage is exact, and a pixel centre on a shared
// edge belongs to one side only. Quads a b c d, clockwise from the top left, fall into the
// triangles abc and acd; those turned over by the motion are not drawn.

layout(binding = 0) uniform sampler2D depth_m;  // in the target's view; inf is sky, <= 0 behind it
layout(binding = 1) uniform sampler2D flow_px;  // target minus source

uniform ivec2 target_size;
uniform ivec2 target_origin;  // in source pixels

const int SUB = 256;              // sub-pixels per pixel
const int GUARD = 16384 * SUB;    // vertices farther out are not drawn
const int NARROW = 64 * SUB;      // products of narrower spans fit 32 bits
const int RINGS = 2;
const uint NOTHING = 0xFFFFFFFFu;
const uint STRETCHED = 0x80000000u;
const float INFINITE = uintBitsToFloat(0x7F800000u);

struct Quad {
    ivec2 a, b, c, d;   // corners, sub-pixels in the target
    vec4 inverse_m;     // 1 / depth of each
    bool drawable;      // no corner behind the camera or beyond the guard
};

ivec2 mesh_size() { return textureSize(depth_m, 0) + 2 * RINGS - 1; }  // quads

ivec2 pixel_of(ivec2 vertex) {
    return clamp(vertex - RINGS, ivec2(0), textureSize(depth_m, 0) - 1);
}

ivec2 displacement(ivec2 pixel) {
    vec2 flow = clamp(texelFetch(flow_px, pixel, 0).xy * float(SUB), -2.0 * GUARD, 2.0 * GUARD);
    return ivec2(roundEven(flow)) - SUB * target_origin;
}

ivec2 position(ivec2 vertex) {
    ivec2 size = textureSize(depth_m, 0);
    ivec2 home = clamp(2 * (vertex - RINGS) + 1, ivec2(0), 2 * size) * (SUB / 2);
    ivec2 at = home + displacement(pixel_of(vertex));
    ivec2 last = size + 2 * RINGS - 1;
    if (vertex.x == 0) at.x = min(at.x, -SUB);
    if (vertex.y == 0) at.y = min(at.y, -SUB);
    if (vertex.x == last.x) at.x = max(at.x, (target_size.x + 1) * SUB);
    if (vertex.y == last.y) at.y = max(at.y, (target_size.y + 1) * SUB);
    return at;
}

float depth_at(ivec2 vertex) { return texelFetch(depth_m, pixel_of(vertex), 0).x; }

bool outside(ivec2 at) { return any(greaterThan(abs(at), ivec2(GUARD))); }

Quad load_quad(ivec2 first) {
    Quad quad;
    quad.a = position(first);
    quad.b = position(first + ivec2(1, 0));
    quad.c = position(first + ivec2(1, 1));
    quad.d = position(first + ivec2(0, 1));
    vec4 depth = vec4(depth_at(first), depth_at(first + ivec2(1, 0)),
                      depth_at(first + ivec2(1, 1)), depth_at(first + ivec2(0, 1)));
    quad.inverse_m = 1.0 / depth;
    quad.drawable = all(greaterThan(depth, vec4(0.0)))
        && !(outside(quad.a) || outside(quad.b) || outside(quad.c) || outside(quad.d));
    return quad;
}

int turn(ivec2 v, ivec2 w) { return v.x * w.y - v.y * w.x; }

double turn(dvec2 v, dvec2 w) { return v.x * w.y - v.y * w.x; }

// Whether a point on the left of edge v is inside, or on it and the edge is top or left.
bool inside(float side, ivec2 v) {
    return side > 0.0 || (side == 0.0 && (v.y < 0 || (v.y == 0 && v.x > 0)));
}

// Whether the quad shows at this pixel's centre, and how the second and third corner of the
// covering triangle weigh there.
bool covers(Quad quad, ivec2 pixel, out vec2 weight, out bool upper) {
    ivec2 centre = pixel * SUB + SUB / 2;
    ivec2 a = quad.a - centre, b = quad.b - centre, c = quad.c - centre, d = quad.d - centre;
    ivec2 span = max(max(abs(a), abs(b)), max(abs(c), abs(d)));
    // Twice the areas of the triangles between the centre and each edge. Their signs are
    // exact: 32 bits hold the products of narrow quads, doubles those of all.
    float ab, bc, ac, cd, da, abc, acd;
    if (max(span.x, span.y) <= NARROW) {
        int i = turn(a, b), j = turn(b, c), k = turn(a, c), l = turn(c, d), m = turn(d, a);
        ab = float(i); bc = float(j); ac = float(k); cd = float(l); da = float(m);
        abc = float(i + j - k); acd = float(k + l + m);
    } else {
        double i = turn(dvec2(a), dvec2(b)), j = turn(dvec2(b), dvec2(c));
        double k = turn(dvec2(a), dvec2(c)), l = turn(dvec2(c), dvec2(d));
        double m = turn(dvec2(d), dvec2(a));
        ab = float(i); bc = float(j); ac = float(k); cd = float(l); da = float(m);
        abc = float(i + j - k); acd = float(k + l + m);
    }
    upper = inside(ab, b - a) && inside(bc, c - b) && inside(-ac, a - c);
    if (upper) {
        weight = vec2(-ac, ab) / abc;
        return true;
    }
    weight = vec2(da, ac) / acd;
    return inside(ac, c - a) && inside(cd, d - c) && inside(da, a - d);
}
