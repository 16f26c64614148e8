// Rank of surfaces at a target pixel: the least key shows, and the first quad among equal keys.
// Twin: partitioned_depth() and nearest() in warp/reference.py.
//
// Eq. 1's partition as integers: the top bit says "stretched". Below it, a surface's key
// falls with inverse depth (nearest wins) and a stretched quad's rises (farthest wins).
// The lowest bit is UNRIVALLED until a nearer quad takes the pixel from another.
//
// Most pixels are covered by one quad. In round 0 every quad lowers the keys of its pixels; who comes
// first to a pixel leaves a claim, who comes later and is not beaten contests it. Round 1 asks
// again only those that contested. The first claim stands while the key is UNRIVALLED, and whatever
// else has the final key contested. So the order in which quads come changes nothing.

struct Rank { uint key, claim; };

layout(std430) buffer Ranks { Rank ranks[]; };  // per target pixel; side by side for the caches
layout(std430) buffer Lists {
    uint counts[2];  // of quads left to large.comp.glsl, and of small quads that contested
    uint left_count;
    uint unreached;  // nonzero: some target pixel was reached by no quad
    uvec3 contested_groups;  // of small.comp.glsl's second dispatch
    // From the start on, quads left to large.comp.glsl; from the end on, small quads that
    // contested; a quad is in one of the two at most. Afterwards, pixels that the first
    // resolve.comp.glsl leaves to the second. Room for all there are.
    uint entries[];
};
// Parts to draw of each large quad: bit k for part k, TORN, CONTESTED. From classify.comp.glsl.
layout(std430) buffer Parts { uint parts[]; };

const int LARGE = 0, CONTESTED_SMALL = 1;  // of counts

const uint TORN = 1u << 8;
const uint CONTESTED = 1u << 9;

// Triangle abc or acd of a part of a quad: 2 * (quad + part * quads), + 1 for acd.
const uint FIRST = 1u << 31;  // of who came first: loses to claims without

const uint UNRIVALLED = 1u;
// Inverse depths beyond these, 1/m, are taken for them: the others' bits leave room for two flags.
const float FARTHEST = uintBitsToFloat(0x20000000u), NEAREST = uintBitsToFloat(0x5F000000u);

// One program does both rounds, and the key's arithmetic is `precise`, so that both compute the
// very same keys.
uniform int round_index;

uint steps_from_infinity(float inverse_m) {
    return floatBitsToUint(clamp(inverse_m, FARTHEST, NEAREST)) - floatBitsToUint(FARTHEST);
}

int cell_of(ivec2 pixel) { return pixel.y * target_size.x + pixel.x; }

// Tells, in round 0, whether the quad contests the pixel. `number` is quad + part * quads.
bool rank(Quad quad, Areas area, uint number, bool stretched, ivec2 pixel) {
    vec2 weight;
    bool upper;
    if (!covers(quad, area, weight, upper)) return false;
    vec4 w = 1.0 / quad.depth;
    vec2 rest = upper ? w.yz : w.zw;
    precise float inverse_m = w.x + weight.x * (rest.x - w.x) + weight.y * (rest.y - w.x);
    uint key = ~STRETCHED - 2u * steps_from_infinity(inverse_m);
    if (stretched)
        key = STRETCHED | UNRIVALLED
            | 2u * steps_from_infinity(min(min(w.x, w.y), min(w.z, w.w)));
    int cell = cell_of(pixel);
    uint claim = 2u * number + (upper ? 0u : 1u);
    if (round_index != 0) {
        uint last = ranks[cell].key;
        if ((last | UNRIVALLED) == key)
            atomicMin(ranks[cell].claim, last == key ? FIRST | claim : claim);
        return false;
    }
    uint before = atomicMin(ranks[cell].key, key);
    if (before == NOTHING) ranks[cell].claim = FIRST | claim;
    else if (key < before) atomicMin(ranks[cell].key, key - UNRIVALLED);
    return before != NOTHING && key <= (before | UNRIVALLED);
}
