// Places and division of noise's filters in whole numbers. Twin: noise/tile.py. Change both or neither.

#constant TAP_BITS  // of a filter's taps behind the point

// A place of what goes on at its borders; never more than once round outside.
ivec2 around(ivec2 place, ivec2 size) {
    return place + size * (ivec2(lessThan(place, ivec2(0))) - ivec2(greaterThanEqual(place, size)));
}

int divided(int sum) { return (sum + (1 << (TAP_BITS - 1))) >> TAP_BITS; }
ivec4 divided(ivec4 sum) { return (sum + (1 << (TAP_BITS - 1))) >> TAP_BITS; }
