// Who shows at a target pixel: the least key, and the first quad among equal keys.
// Twin: partitioned_depth() and nearest() in warp/reference.py.
//
// Eq. 1's partition as integers: the top bit says "stretched". Below it, a surface's key
// falls with inverse depth (nearest wins) and a stretched quad's rises (farthest wins).
//
// Round 0 lowers every pixel's key. Who comes first writes its claim; who comes later and is not
// beaten contests it. So at most pixels, which one quad covers, all is said. Round 1 asks again
// only those that contested, and the first claim counts among those that have the final key. In
// what order they come changes nothing: who set the final key came first or has contested, and so
// has who tied with it.

struct Rank { uint key, claim; };

layout(std430) buffer Ranks { Rank ranks[]; };  // per target pixel

layout(std430) buffer Lists {
    uint large_count;
    uint contested_count;
    uint left_count;
    uint unreached;  // nonzero: some target pixel was reached by no quad
    // From the start on, quads left to large.comp.glsl; from the end on, other quads that
    // contested; a quad is in one of the two at most. Afterwards, pixels left to the second
    // resolve.comp.glsl. Room for all there are.
    uint entries[];
};
// What to draw of each large quad: bit k for part k, TORN, CONTESTED. Written by
// classify.comp.glsl.
layout(std430) buffer Parts { uint parts[]; };

const uint TORN = 1u << 8;
const uint CONTESTED = 1u << 9;

const uint OVERTAKEN = 0x80000000u;  // the first claim is void
const uint NO_CLAIM = ~OVERTAKEN;

// One program does both rounds, and the key's arithmetic is `precise`, so that both compute the
// very same keys.
uniform int round_index;

// A claim is made by a triangle: abc or acd of a part of a quad. In order of parts, then quads.
uint claim_of(uint quad_part, bool upper) { return 2u * quad_part + (upper ? 0u : 1u); }

// Tells, in round 0, whether to come again in round 1.
int cell_of(ivec2 pixel) { return pixel.y * target_size.x + pixel.x; }

bool rank(Quad quad, Areas area, uint quad_part, bool stretched, ivec2 pixel) {
    vec2 weight;
    bool upper;
    if (!covers(quad, area, weight, upper)) return false;
    vec4 w = 1.0 / quad.depth;
    vec2 rest = upper ? w.yz : w.zw;
    precise float inverse_m = w.x + weight.x * (rest.x - w.x) + weight.y * (rest.y - w.x);
    uint key = ~STRETCHED - (~STRETCHED & floatBitsToUint(max(inverse_m, 0.0)));
    if (stretched) key = STRETCHED | floatBitsToUint(min(min(w.x, w.y), min(w.z, w.w)));
    int cell = cell_of(pixel);
    uint claim = claim_of(quad_part, upper);
    if (round_index == 0) {
        uint before = atomicMin(ranks[cell].key, key);
        // Whole bits on either side of the word: these two commute.
        if (before == NOTHING) atomicAnd(ranks[cell].claim, OVERTAKEN | claim);
        else if (key < before) atomicOr(ranks[cell].claim, OVERTAKEN);
        return before != NOTHING && key <= before;
    }
    if (ranks[cell].key == key) atomicMin(ranks[cell].claim, claim);
    return false;
}
