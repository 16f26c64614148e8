// By what to multiply deviations, so that mixed bands measure what they are asked for.
// Twin: spectral_gains() in noise/gains.py. Change both or neither.

#constant LEVELS
#constant LEAST_GAIN       // no band is weakened to less,
#constant MOST_GAIN        // nor raised to more
#constant AIM              // over what a plane asks for
#constant UNSEEN_VARIANCE  // added to the variances asked for and measured
#constant UNEVEN           // of the second level's oriented bands' variance: in its high band
#constant STEPS            // of the iteration

// What a level's three bands measure (rows) of products of deviations: of each two levels i <= j.
// See overlap_by_levels().
const int PAIRS = LEVELS * (LEVELS + 1) / 2;
layout(std140, binding = 0) uniform Overlap { mat4 overlap[LEVELS * PAIRS]; };

// All arrays have room for the most levels, for indices written out.
vec3 asked[6];   // variances; whoever includes this sets them
vec3 gains[6];   // found
vec3 wanted[6];  // deviations, with the gains so far: of the high band, the sum of the oriented ones, their difference

void want(int level, vec3 band) { wanted[level] = vec3(band.x, band.y + band.z, band.y - band.z); }

#define PAIR(i, j)                                                                       \
    {                                                                                    \
        vec3 a = wanted[i], b = wanted[j];                                               \
        mat4 of = overlap[at++];                                                         \
        even += a.x * (b.x * of[0].xy + b.y * of[0].zw)                                  \
              + a.y * (b.x * of[1].xy + b.y * of[1].zw) + (a.z * b.z) * of[2].xy;        \
        odd += dot(of[3], vec4(a.x * b.z, a.z * b.x, a.y * b.z, a.z * b.y));             \
    }

// What a level's bands measure of all that is wanted. Pairs are written out, for arrays that are
// indexed by a variable are slow; levels are not, or the driver compiles for 10 to 30 s.
vec3 measured_at(int level) {
    vec2 even = vec2(0.0);  // of the high band, and half the oriented ones' sum
    float odd = 0.0;        // half their difference
    int at = level * PAIRS;
    PAIR(0, 0)
    if (LEVELS > 1) PAIR(0, 1)
    if (LEVELS > 2) PAIR(0, 2)
    if (LEVELS > 3) PAIR(0, 3)
    if (LEVELS > 4) PAIR(0, 4)
    if (LEVELS > 5) PAIR(0, 5)
    if (LEVELS > 1) PAIR(1, 1)
    if (LEVELS > 2) PAIR(1, 2)
    if (LEVELS > 3) PAIR(1, 3)
    if (LEVELS > 4) PAIR(1, 4)
    if (LEVELS > 5) PAIR(1, 5)
    if (LEVELS > 2) PAIR(2, 2)
    if (LEVELS > 3) PAIR(2, 3)
    if (LEVELS > 4) PAIR(2, 4)
    if (LEVELS > 5) PAIR(2, 5)
    if (LEVELS > 3) PAIR(3, 3)
    if (LEVELS > 4) PAIR(3, 4)
    if (LEVELS > 5) PAIR(3, 5)
    if (LEVELS > 4) PAIR(4, 4)
    if (LEVELS > 5) PAIR(4, 5)
    if (LEVELS > 5) PAIR(5, 5)
    return max(vec3(even.x, even.y + odd, even.y - odd), vec3(0.0));
}

// After a step, in a level.
vec3 gain_of(int level, vec3 variance, vec3 gain) {
    vec3 measured = measured_at(level), given = gain * gain * variance;
    if (level == 1) measured.x += UNEVEN * 0.5 * (given.y + given.z);
    gain *= sqrt((variance + UNSEEN_VARIANCE) / (measured + UNSEEN_VARIANCE));
    return clamp(gain, LEAST_GAIN, MOST_GAIN);
}

void find_gains() {
    gains[0] = gains[1] = gains[2] = gains[3] = gains[4] = gains[5] = vec3(1.0);
    for (int step = 0; step < STEPS; ++step) {
#define EACH_LEVEL(DO) DO(0) if (LEVELS > 1) DO(1) if (LEVELS > 2) DO(2) if (LEVELS > 3) DO(3) \
                       if (LEVELS > 4) DO(4) if (LEVELS > 5) DO(5)
#define WANT(i) want(i, gains[i] * sqrt(asked[i]));
        EACH_LEVEL(WANT)
        for (int level = 0; level < LEVELS; ++level) {
            vec3 variance, gain;
#define TAKE(i) if (level == i) { variance = asked[i]; gain = gains[i]; }
            EACH_LEVEL(TAKE)
            gain = gain_of(level, variance, gain);
#define PUT(i) if (level == i) gains[i] = gain;
            EACH_LEVEL(PUT)
        }
    }
    for (int level = 0; level < 6; ++level) gains[level] *= AIM;
}
