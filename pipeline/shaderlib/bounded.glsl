// Noise kept on the display. Twin: added() in foveation/pooled_moments.py. Change both or neither.

#constant FREE               // deviations from the nearest end, see pooled_moments.py
#constant BOUND
#constant LEAST_VALUE        // of a base, from either end
#constant MOST_FILLED        // of the variance of the two ends without anything between
#constant STEEPEST
#constant SHARPENED          // share of the variance that is left out at most
#constant EXCESS             // kurtosis of noise
#constant FARTHEST           // deviations from the base
#constant SURE
#constant LEAST_ALIKE
#constant MOST_ALIKE
#constant LEAST_ROOM
#constant MOST_ROOM
#constant SLACK
#constant SMALLEST_VARIANCE

// The normal distribution's function, and its inverse (Abramowitz and Stegun 1964, 26.2.19 and 26.2.23,
// within 2e-7 and 5e-4).
vec3 normal_share(vec3 z) {
    vec3 x = abs(z);
    vec3 power = 1.0 + x * (0.0498673470 + x * (0.0211410061 + x * (0.0032776263
               + x * (0.0000380036 + x * (0.0000488906 + x * 0.0000053830)))));
    power *= power;
    power *= power;
    power *= power;
    vec3 tail = 0.5 / (power * power);
    return mix(tail, 1.0 - tail, greaterThan(z, vec3(0.0)));
}

// Place where the function has a value, and the density there (within 5e-5 of itself).
struct Normal { vec3 place, density; };

Normal normal_at(vec3 share) {
    vec3 tail = min(share, 1.0 - share), t = sqrt(-2.0 * log(tail));
    vec3 place = t - (2.515517 + t * (0.802853 + t * 0.010328))
                   / (1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308)));
    vec3 hazard = -0.13327328 + t * (0.56240229 + t * (0.27567911 + t * (-0.08337629
                + t * (0.01283423 - t * 0.00079899))));
    return Normal(mix(-place, place, greaterThan(share, vec3(0.5))), tail * hazard);
}

// Twin: pool_slope().
vec3 slope_of(vec3 filled, vec3 most, vec3 density) {
    const float root_of_pi = 1.77245385;
    vec3 left = root_of_pi * most * (1.0 - filled);
    return min(sqrt(filled) * (sqrt(most) * left + filled * density * density) / (density * left), STEEPEST);
}

// Of noise's red, green and blue: the deviation, 1 over it, how far from the base noise may lead, and
// how far it goes with luma.
struct Spread { vec3 deviation, rate, below, above, along; };

// Spread over all of the display. Twin: along_luma().
Spread spread_of(vec3 variance, vec3 cross_luma, vec4 variances) {
    vec3 rate = inversesqrt(variance + SMALLEST_VARIANCE);
    const float least = SMALLEST_VARIANCE * SMALLEST_VARIANCE;
    vec3 along = SURE * cross_luma * inversesqrt(variances.rgb * variances.a + least);
    return Spread(1.0 / rate, rate, vec3(1.0), vec3(1.0), clamp(along, -1.0, 1.0));
}

float largest(vec3 of) { return max(of.r, max(of.g, of.b)); }

float smallest(vec3 of) { return min(of.r, min(of.g, of.b)); }

vec3 where_against(vec3 along, vec3 then, vec3 otherwise) {
    return mix(otherwise, then, lessThan(along, vec3(0.0)));
}

// Below and above along luma.
vec2 shared_room(vec3 below, vec3 above, Spread spread) {
    vec3 less = largest(spread.deviation) * spread.rate;
    vec3 slack = SLACK * less * less * less / max(abs(spread.along), SMALLEST_VARIANCE);
    vec3 down = where_against(spread.along, above, below) + slack;
    vec3 up = where_against(spread.along, below, above) + slack;
    return vec2(smallest(down), smallest(up));
}

// Likeness of the ends of a pool's channels, from 0 to 1. Twin: along_pool().
float alike(Spread spread) {
    vec3 below = min(spread.below * spread.rate, FARTHEST), above = min(spread.above * spread.rate, FARTHEST);
    vec2 shared_by = shared_room(below, above, spread);
    float share = shared_by.x * shared_by.y / smallest(below * above);
    return clamp((share - LEAST_ALIKE) / (MOST_ALIKE - LEAST_ALIKE), 0.0, 1.0);
}

// Add normal noise to R'G'B'. Where there is none, the base stays as it is.
vec3 added(vec3 base, vec3 noise, Spread spread) {
    if (noise == vec3(0.0)) return base;
    vec3 changed = base + noise;
    vec3 below = min(min(spread.below, base) * spread.rate, FARTHEST);
    vec3 above = min(min(spread.above, 1.0 - base) * spread.rate, FARTHEST), room = min(below, above);
    float share = clamp((FREE - smallest(room)) / (FREE - BOUND), 0.0, 1.0);
    if (share > 0.0) {
        vec2 shared_by = shared_room(below, above, spread);
        vec3 down = where_against(spread.along, shared_by.yyy, shared_by.xxx);
        vec3 up = where_against(spread.along, shared_by.xxx, shared_by.yyy);
        float enough = clamp((shared_by.x * shared_by.y - LEAST_ROOM) / (MOST_ROOM - LEAST_ROOM), 0.0, 1.0);
        vec3 varied = min(2.0 * spread.deviation / largest(spread.deviation), 1.0);
        vec3 together = abs(spread.along) * varied * varied * enough;
        below += together * min(down - below, 0.0);
        above += together * min(up - above, 0.0);
        vec3 width = below + above, part = 1.0 / width;
        vec3 place = clamp(below * part, LEAST_VALUE, 1.0 - LEAST_VALUE);
        vec3 most = place * (1.0 - place), filled = min(part * part / most, MOST_FILLED);
        Normal normal = normal_at(place);
        vec3 mean = normal.place, slope = slope_of(filled * (1.0 - SHARPENED * filled), most, normal.density);
        vec3 square = slope * slope, wide = 1.0 + square, bend = square / wide;
        mean -= EXCESS / 24.0 * bend * bend * mean * (3.0 - mean * mean);
        vec3 shown = normal_share(mean * sqrt(wide) + slope * noise * spread.rate);
        changed = mix(changed, base + spread.deviation * (width * shown - below), share);
    }
    return clamp(changed, 0.0, 1.0);
}
