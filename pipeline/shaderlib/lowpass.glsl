// The pyramid's low-pass, of 4x4 texels in rows. Twin: halve() in features/reference.py.

#constant LOW_INNER   // taps of the 4x4 kernel: both offsets inner,
#constant LOW_MIXED   // one outer,
#constant LOW_OUTER   // both outer

vec4 low_outer(vec4 a, vec4 b, vec4 c, vec4 d) { return LOW_OUTER * (a + d) + LOW_MIXED * (b + c); }
vec4 low_inner(vec4 a, vec4 b, vec4 c, vec4 d) { return LOW_MIXED * (a + d) + LOW_INNER * (b + c); }

// Indices of four neighbours from `first` on, along an axis of `count` texels.
ivec4 neighbours(int first, int count, bool wraps) {
    ivec4 index = first + ivec4(0, 1, 2, 3);
    // Never more than a whole turn outside, but for tiny pictures.
    return wraps ? (index + 4 * count) % count : clamp(index, 0, count - 1);
}
