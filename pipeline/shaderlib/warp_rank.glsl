// Who shows at a target pixel: the least key, and the first quad among equal keys.
// Twin: partitioned_depth(), nearest() and resolve() in warp/reference.py.
//
// Eq. 1's partition as integers: the top bit says "stretched". Below it, a surface's key
// falls with inverse depth (nearest wins) and a stretched quad's rises (farthest wins).
//
// Most pixels are covered by one quad. So in round 0 who comes first to a pixel shows itself there
// and leaves its claim. Who comes later marks the pixel as SHARED, and contests it if it is
// not beaten. Round 1 asks only those again that contested: the first claim stands if it has the
// final key, and so has every other quad with that key contested. What is shared is shown again by
// mend.comp.glsl. So the order in which quads come changes no bit.

struct Rank { uint key, claim; };

layout(std430) buffer Ranks { Rank ranks[]; };  // per target pixel
layout(std430) buffer Lists {
    uint large_count;
    uint contested_count;
    uint shared_count;
    uint unreached;  // nonzero: some target pixel was reached by no quad
    // From the start on, quads left to large.comp.glsl; from the end on, other quads that
    // contested; a quad is in one of the two at most. Afterwards, pixels that are shared.
    // Room for all there are.
    uint entries[];
};
// What to draw of each large quad: bit k for part k, TORN, CONTESTED. Written by
// classify.comp.glsl.
layout(std430) buffer Parts { uint parts[]; };

const uint TORN = 1u << 8;
const uint CONTESTED = 1u << 9;

// A claim is a quad's number, + part * quads, and two flags.
const uint OVERTAKEN = 1u << 31;  // the first claim is void
const uint SHARED = 1u << 30;
const uint NO_CLAIM = SHARED - 1u;

layout(rgba32f) uniform readonly image2D colour;  // encoded R'G'B', source

// rgb: encoded colour, 0 in holes. a: 1 known, 0 hole.
layout(rgba32f) uniform writeonly image2D warped_colour;
// Metres; in holes the background's. 0 where no quad reached: continue.comp.glsl fills it.
layout(r32f) uniform writeonly image2D warped_depth_m;
layout(rg32f) uniform writeonly image2D warped_flow_px;

int cell_of(ivec2 pixel) { return pixel.y * target_size.x + pixel.x; }

void store(ivec2 pixel, vec4 shown, float depth, vec2 motion) {
    imageStore(warped_colour, pixel, shown);
    imageStore(warped_depth_m, pixel, vec4(depth));
    imageStore(warped_flow_px, pixel, vec4(motion, 0.0, 0.0));
}

// 1 / depth is linear in the image plane. This form gives back one depth of three exactly
// where it alone counts, and where all three are the same.
float blend_depth(float a, float b, float c, vec2 weight) {
    if (weight == vec2(0.0)) return a;
    if (isinf(a)) {
        float inverse = weight.x / b + weight.y / c;
        return inverse > 0.0 ? 1.0 / inverse : INFINITE;
    }
    float ratio = 1.0 + weight.x * (a / b - 1.0) + weight.y * (a / c - 1.0);
    return ratio > 0.0 ? a / ratio : INFINITE;
}

vec3 colour_at(ivec2 first, int part, int k) {
    return imageLoad(colour, pixel_of(first + corner(source_of(part, k)))).rgb;
}

void show_surface(ivec2 pixel, Quad quad, ivec2 first, int part, vec2 weight, bool upper) {
    vec3 base = colour_at(first, part, 0);
    vec3 second = colour_at(first, part, upper ? 1 : 2);
    vec3 third = colour_at(first, part, upper ? 2 : 3);
    vec3 mixed = base + weight.x * (second - base) + weight.y * (third - base);
    vec2 motion = quad.fa + weight.x * ((upper ? quad.fb : quad.fc) - quad.fa)
                + weight.y * ((upper ? quad.fc : quad.fd) - quad.fa);
    vec2 rest = upper ? quad.depth.yz : quad.depth.zw;
    float depth = blend_depth(quad.depth.x, rest.x, rest.y, weight);
    store(pixel, vec4(clamp(mixed, 0.0, 1.0), 1.0), depth, motion);
}

// In holes the farthest corner's; the first of equals, in reading order.
void show_hole(ivec2 pixel, Quad quad) {
    float depth = quad.depth.x;
    vec2 motion = quad.fa;
    if (quad.depth.y > depth) { depth = quad.depth.y; motion = quad.fb; }
    if (quad.depth.w > depth) { depth = quad.depth.w; motion = quad.fd; }
    if (quad.depth.z > depth) { depth = quad.depth.z; motion = quad.fc; }
    store(pixel, vec4(0.0), depth, motion);
}

// One program does both rounds, and the key's arithmetic is `precise`, so that both compute the
// very same keys.
uniform int round_index;

// Tells, in round 0, whether the quad contests the pixel.
bool rank(Quad quad, Areas area, ivec2 first, int part, bool stretched, ivec2 pixel) {
    vec2 weight;
    bool upper;
    if (!covers(quad, area, weight, upper)) return false;
    vec4 w = 1.0 / quad.depth;
    vec2 rest = upper ? w.yz : w.zw;
    precise float inverse_m = w.x + weight.x * (rest.x - w.x) + weight.y * (rest.y - w.x);
    uint key = ~STRETCHED - (~STRETCHED & floatBitsToUint(max(inverse_m, 0.0)));
    if (stretched) key = STRETCHED | floatBitsToUint(min(min(w.x, w.y), min(w.z, w.w)));
    int cell = cell_of(pixel);
    ivec2 mesh = mesh_size();
    uint claim = uint((part * mesh.y + first.y) * mesh.x + first.x);
    if (round_index != 0) {
        if (ranks[cell].key == key) atomicMin(ranks[cell].claim, SHARED | claim);
        return false;
    }
    uint before = atomicMin(ranks[cell].key, key);
    if (before == NOTHING) {
        // Other bits than those that later ones set: it does not matter who is faster.
        atomicAnd(ranks[cell].claim, ~NO_CLAIM | claim);
        if (stretched) show_hole(pixel, quad);
        else show_surface(pixel, quad, first, part, weight, upper);
        return false;
    }
    atomicOr(ranks[cell].claim, key < before ? OVERTAKEN | SHARED : SHARED);
    return key <= before;
}
