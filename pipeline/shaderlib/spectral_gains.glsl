// By what to multiply deviations, so that mixed bands measure what they are asked for.
// Twin: spectral_gains() in noise/gains.py. Change both or neither.

#constant LEVELS
#constant LEAST_GAIN       // no band is weakened to less,
#constant MOST_GAIN        // nor raised to more
#constant AIM              // over what a plane asks for
#constant UNSEEN_VARIANCE  // added to the variances asked for and measured
#constant UNEVEN           // of the second level's oriented bands' variance: in its high band
#constant STEPS            // of the iteration
#constant OVERLAP          // see below
#constant TOGETHER         // of the variance of all bands' sum; see together_by_levels()

// Measures (rows) of a level's three bands of products of deviations: of each two levels i <= j.
// See overlap_by_levels(). Written into the code: reading it would take longer than all else here.
const int PAIRS = LEVELS * (LEVELS + 1) / 2;
const float[] OVERLAPS = OVERLAP;
#define OF(level, at, number) OVERLAPS[clamp(16 * ((level) * PAIRS + (at)) + (number), 0, 16 * LEVELS * PAIRS - 1)]

// All arrays have room for the most levels, for indices written out.
vec3 asked[6];   // variances; whoever includes this sets them
vec3 gains[6];   // found
vec3 wanted[6];  // deviations, with the gains so far: of the high band, the sum of the oriented ones, their difference

void want(int level, vec3 band) { wanted[level] = vec3(band.x, band.y + band.z, band.y - band.z); }

// Measures of all levels' bands: of the high band; half the oriented ones' sum, and difference.
vec3 measured[6];

// Add what a level's bands measure of a pair of levels, `at` of all pairs.
#define MEASURE(level, at)                                                                         \
    if (level < LEVELS) {                                                                          \
        measured[level] += vec3(                                                                   \
            high_high * OF(level, at, 0) + high_sum * OF(level, at, 2) + sum_high * OF(level, at, 4) \
                + sum_sum * OF(level, at, 6) + apart_apart * OF(level, at, 8),                     \
            high_high * OF(level, at, 1) + high_sum * OF(level, at, 3) + sum_high * OF(level, at, 5) \
                + sum_sum * OF(level, at, 7) + apart_apart * OF(level, at, 9),                     \
            crossed.x * OF(level, at, 12) + crossed.y * OF(level, at, 13)                          \
                + crossed.z * OF(level, at, 14) + crossed.w * OF(level, at, 15));                  \
    }

// A pair's products of deviations, which all levels share. All is written out, for arrays that are
// indexed by a variable are slow.
#define PAIR(i, j)                                                                              \
    if (j < LEVELS) {                                                                           \
        vec3 a = wanted[i], b = wanted[j];                                                      \
        float high_high = a.x * b.x, high_sum = a.x * b.y, sum_high = a.y * b.x;                \
        float sum_sum = a.y * b.y, apart_apart = a.z * b.z;                                     \
        vec4 crossed = vec4(a.x * b.z, a.z * b.x, a.y * b.z, a.z * b.y);                        \
        const int at = (i) * (2 * LEVELS - (i) + 1) / 2 + (j) - (i);                            \
        MEASURE(0, at) MEASURE(1, at) MEASURE(2, at) MEASURE(3, at) MEASURE(4, at) MEASURE(5, at) \
    }

// After a step, in a level.
vec3 gain_of(int level, vec3 variance, vec3 gain) {
    vec3 own = measured[level], given = gain * gain * variance;
    vec3 found = max(vec3(own.x, own.y + own.z, own.y - own.z), 0.0);
    if (level == 1) found.x += UNEVEN * 0.5 * (given.y + given.z);
    gain *= sqrt((variance + UNSEEN_VARIANCE) / (found + UNSEEN_VARIANCE));
    return clamp(gain, LEAST_GAIN, MOST_GAIN);
}

void find_gains() {
#define EACH_LEVEL(DO) DO(0) if (LEVELS > 1) DO(1) if (LEVELS > 2) DO(2) if (LEVELS > 3) DO(3) \
                       if (LEVELS > 4) DO(4) if (LEVELS > 5) DO(5)
#define START(i) gains[i] = vec3(1.0);
    EACH_LEVEL(START)
    for (int step = 0; step < STEPS; ++step) {
#define WANT(i) { want(i, gains[i] * sqrt(asked[i])); measured[i] = vec3(0.0); }
        EACH_LEVEL(WANT)
        PAIR(0, 0) PAIR(0, 1) PAIR(0, 2) PAIR(0, 3) PAIR(0, 4) PAIR(0, 5)
        PAIR(1, 1) PAIR(1, 2) PAIR(1, 3) PAIR(1, 4) PAIR(1, 5)
        PAIR(2, 2) PAIR(2, 3) PAIR(2, 4) PAIR(2, 5)
        PAIR(3, 3) PAIR(3, 4) PAIR(3, 5)
        PAIR(4, 4) PAIR(4, 5)
        PAIR(5, 5)
#define STEP(i) gains[i] = gain_of(i, asked[i], gains[i]);
        EACH_LEVEL(STEP)
    }
#define AIMED(i) gains[i] *= AIM;
    EACH_LEVEL(AIMED)
}

const float[] TOGETHERS = TOGETHER;

// Of the sum of all bands, where each has the variance asked for and its gain.
float deviation_of_all() {
    float variance = 0.0;
#define WITH_GAINS(i) want(i, gains[i] * sqrt(asked[i]));
    EACH_LEVEL(WITH_GAINS)
    int at = 0;
    for (int i = 0; i < LEVELS; ++i)
        for (int j = i; j < LEVELS; ++j, at += 5) {
            vec3 a = wanted[i], b = wanted[j];
            variance += TOGETHERS[at] * a.x * b.x + TOGETHERS[at + 1] * a.x * b.y + TOGETHERS[at + 2] * a.y * b.x
                      + TOGETHERS[at + 3] * a.y * b.y + TOGETHERS[at + 4] * a.z * b.z;
        }
    return sqrt(max(variance, 0.0));
}
