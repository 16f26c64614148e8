// The mesh that the warp draws: one quad between every four neighbouring vertices.
// Twin: moved_mesh(), with_strips(), with_thin(), coverage() and inside() in warp/reference.py.
//
// Vertices are the source pixels and two more rings around them. Ring 1 ends the border
// pixels' own footprint, half a pixel out. Ring 0 lies beyond the target's edge: its quads
// carry the border's depth into what enters the view.
//
// Positions are integers in sub-pixels, so coverage is exact, and a pixel centre on a shared
// edge belongs to one side only. Quads a b c d, clockwise from the top left, fall into the
// triangles abc and acd; those turned over by the motion are not drawn.
//
// Part 0 of a quad is the quad. Part k + 1 of a torn quad is the strip along its side k (a b,
// b c, c d, d a) that belongs to the whole quad beyond: half its extent, carried on. Parts 5 and
// 6 are the bands along a b and a d, where these are whole and one pixel thin, and part 7 is the
// pixel of a where nothing else shows it.

// Images, not samplers: llvmpipe loads them three times faster.
layout(r32f) uniform readonly image2D depth_m;   // in the target's view; inf is
                                                              // sky, <= 0 behind the camera
layout(rg32f) uniform readonly image2D flow_px;  // target minus source

uniform ivec2 target_size;
uniform ivec2 target_origin;  // in source pixels

const int SUB = 256;              // sub-pixels per pixel
const int GUARD = 16384 * SUB;    // vertices farther out are not drawn
const int NARROW = 64 * SUB;      // products of narrower spans fit 32 bits
const int REACH = 64 * SUB;       // how far beyond the view a torn quad's strips are looked for
const int RINGS = 2;
const int BAND = 5;   // part of a quad: the band along a b; the next along a d
const int SPECK = 7;  // part of a quad: the pixel of a
const uint NOTHING = 0xFFFFFFFFu;
const uint STRETCHED = 0x80000000u;
const float INFINITE = uintBitsToFloat(0x7F800000u);

struct Quad {
    ivec2 a, b, c, d;      // corners, sub-pixels in the target
    vec2 fa, fb, fc, fd;   // flow, pixels
    vec4 depth;            // metres
};

ivec2 mesh_size() { return imageSize(depth_m) + 2 * RINGS - 1; }  // quads

ivec2 pixel_of(ivec2 vertex) {
    return clamp(vertex - RINGS, ivec2(0), imageSize(depth_m) - 1);
}

ivec2 subpixels(vec2 flow) {
    return ivec2(roundEven(clamp(flow * float(SUB), -2.0 * GUARD, 2.0 * GUARD)));
}

// Of a vertex of ring 1 or a pixel.
ivec2 position(ivec2 vertex, vec2 flow) {
    ivec2 home = clamp(2 * (vertex - RINGS) + 1, ivec2(0), 2 * imageSize(depth_m)) * (SUB / 2);
    return home + subpixels(flow) - SUB * target_origin;
}

ivec2 position_in_any_ring(ivec2 vertex, vec2 flow) {
    ivec2 at = position(vertex, flow);
    ivec2 last = imageSize(depth_m) + 2 * RINGS - 1;
    if (vertex.x == 0) at.x = min(at.x, -SUB);
    if (vertex.y == 0) at.y = min(at.y, -SUB);
    if (vertex.x == last.x) at.x = max(at.x, (target_size.x + 1) * SUB);
    if (vertex.y == last.y) at.y = max(at.y, (target_size.y + 1) * SUB);
    return at;
}

ivec2 corner(int k) { return ivec2((k & 3) == 1 || (k & 3) == 2, (k & 3) >= 2); }

ivec2 outwards(int k) { return ivec2(k == 1 ? 1 : k == 3 ? -1 : 0, k == 0 ? -1 : k == 2 ? 1 : 0); }

// Column and row of a number, counted row by row; exact. llvmpipe divides whole numbers lane by lane.
ivec2 place_of(int index, int columns) {
    int row = int(float(index) / float(columns));  // off by one at most
    int column = index - row * columns;
    if (column < 0) return ivec2(column + columns, row - 1);
    if (column >= columns) return ivec2(column - columns, row + 1);
    return ivec2(column, row);
}

bool is_strip(int part) { return part > 0 && part < BAND; }

// Vertex of its quad (0 to 3: a b c d) that gives a part's corner `k` colour, motion and depth.
int source_of(int part, int k) {
    int second = k == 1 || k == 2 ? 1 : 0;
    return part == 0 ? k : is_strip(part) ? (part - 1 + second) & 3
         : part == BAND ? second : part == BAND + 1 ? 3 * second : 0;
}

Quad load_quad(ivec2 first, int part) {
    bool strip = is_strip(part);
    ivec2 va = first + corner(source_of(part, 0));
    ivec2 vb = first + corner(source_of(part, 1));
    ivec2 vc = strip ? vb + outwards(part - 1) : first + corner(source_of(part, 2));
    ivec2 vd = strip ? va + outwards(part - 1) : first + corner(source_of(part, 3));
    ivec2 pa = pixel_of(va), pb = pixel_of(vb), pc = pixel_of(vc), pd = pixel_of(vd);
    Quad quad;
    quad.fa = imageLoad(flow_px, pa).xy;
    quad.fb = imageLoad(flow_px, pb).xy;
    quad.fc = imageLoad(flow_px, pc).xy;
    quad.fd = imageLoad(flow_px, pd).xy;
    quad.a = position_in_any_ring(va, quad.fa);
    quad.b = position_in_any_ring(vb, quad.fb);
    quad.c = position_in_any_ring(vc, quad.fc);
    quad.d = position_in_any_ring(vd, quad.fd);
    quad.depth = vec4(imageLoad(depth_m, pa).x, imageLoad(depth_m, pb).x,
                      imageLoad(depth_m, pc).x, imageLoad(depth_m, pd).x);
    if (strip) {
        quad.c = quad.b + ((quad.b - quad.c) >> 1);
        quad.d = quad.a + ((quad.a - quad.d) >> 1);
        quad.fc = quad.fb;
        quad.fd = quad.fa;
        quad.depth.zw = quad.depth.yx;
    } else if (part == SPECK) {
        quad.a += ivec2(-SUB / 2, -SUB / 2);
        quad.b += ivec2(SUB / 2, -SUB / 2);
        quad.c += ivec2(SUB / 2, SUB / 2);
        quad.d += ivec2(-SUB / 2, SUB / 2);
    } else if (part >= BAND) {
        ivec2 along = quad.b - quad.a;
        ivec2 across = ivec2(along.y, -along.x);
        ivec2 half_way = across >> 1;
        quad.c = quad.b + half_way - across;
        quad.d = quad.a + half_way - across;
        quad.a += half_way;
        quad.b += half_way;
    }
    return quad;
}

ivec2 lowest(Quad quad) { return min(min(quad.a, quad.b), min(quad.c, quad.d)); }

ivec2 highest(Quad quad) { return max(max(quad.a, quad.b), max(quad.c, quad.d)); }

// Not drawn is what has a corner behind the camera or beyond the guard.
bool drawable(Quad quad) {
    return all(greaterThan(quad.depth, vec4(0.0)))
        && all(greaterThanEqual(lowest(quad), ivec2(-GUARD)))
        && all(lessThanEqual(highest(quad), ivec2(GUARD)));
}

bool in_ring_0(ivec2 first) {
    return any(equal(first, ivec2(0))) || any(equal(first, mesh_size() - 1));
}

int longest(ivec2 v) { return max(abs(v.x), abs(v.y)); }

int turn(ivec2 v, ivec2 w) { return v.x * w.y - v.y * w.x; }

double turn(dvec2 v, dvec2 w) { return v.x * w.y - v.y * w.x; }

// Twice the areas of the triangles between a pixel's centre and each edge, and of abc and acd.
// Their signs are exact.
struct Areas { float ab, bc, ac, cd, da, abc, acd; };

// For quads and centres within NARROW of each other, whose products fit 32 bits.
Areas narrow_areas(ivec2 a, ivec2 b, ivec2 c, ivec2 d) {
    int ab = turn(a, b), bc = turn(b, c), ac = turn(a, c), cd = turn(c, d), da = turn(d, a);
    return Areas(float(ab), float(bc), float(ac), float(cd), float(da),
                 float(ab + bc - ac), float(ac + cd + da));
}

// For all quads: doubles hold the products exactly.
Areas wide_areas(dvec2 a, dvec2 b, dvec2 c, dvec2 d) {
    double ab = turn(a, b), bc = turn(b, c), ac = turn(a, c), cd = turn(c, d), da = turn(d, a);
    return Areas(float(ab), float(bc), float(ac), float(cd), float(da),
                 float(ab + bc - ac), float(ac + cd + da));
}

// True if a point on the left of `edge` is inside, or on it and the edge is top or left.
bool inside(float area, ivec2 edge) {
    return area > 0.0 || (area == 0.0 && (edge.y < 0 || (edge.y == 0 && edge.x > 0)));
}

// True if abc or acd covers the centre; and the weights of its second and third corner there.
bool covers(Quad quad, Areas area, out vec2 weight, out bool upper) {
    upper = inside(area.ab, quad.b - quad.a) && inside(area.bc, quad.c - quad.b)
        && inside(-area.ac, quad.a - quad.c);
    weight = upper ? vec2(-area.ac, area.ab) / area.abc : vec2(area.da, area.ac) / area.acd;
    return upper || (inside(area.ac, quad.c - quad.a) && inside(area.cd, quad.d - quad.c)
                     && inside(area.da, quad.a - quad.d));
}
