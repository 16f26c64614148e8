// Who shows at a target pixel: the least key, and the first quad among equal keys.
// Twin: partitioned_depth() and nearest() in warp/reference.py.
//
// Eq. 1's partition as integers: the top bit says "stretched". Below it, a surface's key
// falls with inverse depth (nearest wins) and a stretched quad's rises (farthest wins).

layout(std430) buffer Keys { uint keys[]; };        // per target pixel
layout(std430) buffer Winners { uint winners[]; };  // per target pixel, quad + part * quads
layout(std430) buffer Large {
    uint large_count;
    uint unreached;      // nonzero: some target pixel was reached by no quad
    uint large[];        // quads left to large.comp.glsl; room for all there are
};
// What to draw of each listed quad: bit k for part k, and TORN. Written by classify.comp.glsl.
layout(std430) buffer Parts { uint parts[]; };

const uint TORN = 1u << 8;

// 0: find the least key. 1: find the first quad that has it. One program does both, and the
// key's arithmetic is `precise`, so that both compute the very same keys.
uniform int round_index;

void rank(Quad quad, Areas area, uint index, bool stretched, ivec2 pixel) {
    vec2 weight;
    bool upper;
    if (!covers(quad, area, weight, upper)) return;
    vec4 w = 1.0 / quad.depth;
    vec2 rest = upper ? w.yz : w.zw;
    precise float inverse_m = w.x + weight.x * (rest.x - w.x) + weight.y * (rest.y - w.x);
    uint key = ~STRETCHED - (~STRETCHED & floatBitsToUint(max(inverse_m, 0.0)));
    if (stretched) key = STRETCHED | floatBitsToUint(min(min(w.x, w.y), min(w.z, w.w)));
    uint cell = uint(pixel.y * target_size.x + pixel.x);
    if (round_index == 0) {
        atomicMin(keys[cell], key);
    } else if (keys[cell] == key) {
        atomicMin(winners[cell], index);
    }
}
