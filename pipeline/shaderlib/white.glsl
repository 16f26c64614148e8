// White noise in whole numbers. Twin: white_steps() in noise/tile.py. Change both or neither.

#constant WHITE_BITS

#include "hashing.glsl"

uniform uvec3 key;

// Of three channels.
ivec3 white_at(ivec2 place) {
    uvec3 bits = pcg3d(uvec3(place, 0) ^ key) >> uint(32 - WHITE_BITS);
    return 2 * ivec3(bits) + (1 - (1 << WHITE_BITS));
}
