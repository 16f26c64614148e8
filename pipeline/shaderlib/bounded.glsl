// Noise kept on the display. Twin: added() in foveation/pooled_moments.py. Change both or neither.

#constant FREE               // deviations from the nearest end, see pooled_moments.py
#constant BOUND
#constant LEAST_VALUE        // of a base, from either end
#constant MOST_FILLED        // of the variance of the two ends without anything between
#constant STEEPEST
#constant SHARPENED          // share of the variance that is left out at most
#constant EXCESS             // kurtosis of noise
#constant FARTHEST           // deviations from the base
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

// Of noise's red, green and blue: the deviation, 1 over it, and how far from the base noise may lead.
struct Spread { vec3 deviation, rate, below, above; };

// Spread over all of the display.
Spread spread_of(vec3 variance) {
    vec3 rate = inversesqrt(variance + SMALLEST_VARIANCE);
    return Spread(1.0 / rate, rate, vec3(1.0), vec3(1.0));
}

// Add normal noise to R'G'B'. Where there is none, the base stays as it is.
vec3 added(vec3 base, vec3 noise, Spread spread) {
    if (noise == vec3(0.0)) return base;
    vec3 changed = base + noise, reach = FARTHEST * spread.deviation;
    vec3 low = max(base - min(spread.below, reach), 0.0), high = min(base + min(spread.above, reach), 1.0);
    vec3 room = min(base - low, high - base) * spread.rate;
    float share = clamp((FREE - min(room.r, min(room.g, room.b))) / (FREE - BOUND), 0.0, 1.0);
    if (share > 0.0) {
        vec3 width = high - low, part = 1.0 / width, deviation = spread.deviation * part;
        vec3 place = clamp((base - low) * part, LEAST_VALUE, 1.0 - LEAST_VALUE);
        vec3 most = place * (1.0 - place), filled = min(deviation * deviation / most, MOST_FILLED);
        Normal normal = normal_at(place);
        vec3 mean = normal.place, slope = slope_of(filled * (1.0 - SHARPENED * filled), most, normal.density);
        vec3 square = slope * slope, wide = 1.0 + square, bend = square / wide;
        mean -= EXCESS / 24.0 * bend * bend * mean * (3.0 - mean * mean);
        vec3 bent = low + width * normal_share(mean * sqrt(wide) + slope * noise * spread.rate);
        changed = mix(changed, bent, share);
    }
    return clamp(changed, 0.0, 1.0);
}
