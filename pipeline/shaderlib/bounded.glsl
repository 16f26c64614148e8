// Noise kept on the display. Twin: foveation/bounded.py. Change both or neither.

#constant FREE               // deviations from the nearest end, see bounded.py
#constant BOUND
#constant LEAST_VALUE        // of a base, from either end
#constant MOST_FILLED        // of the variance of the two ends without anything between
#constant STEEPEST
#constant SHARPENED          // share of the variance that is left out at most
#constant EXCESS             // kurtosis of noise
#constant SMALLEST_VARIANCE

// The normal distribution, its function, and that one's inverse (Abramowitz and Stegun 1964, 26.2.16
// and 26.2.23, within 1e-5 and 5e-4).
vec3 normal_density(vec3 z) { return exp(-0.5 * z * z) / 2.50662827; }

vec3 normal_share(vec3 z) {
    vec3 t = 1.0 / (1.0 + 0.33267 * abs(z));
    vec3 tail = normal_density(z) * t * (0.4361836 + t * (-0.1201676 + t * 0.937298));
    return mix(tail, 1.0 - tail, greaterThan(z, vec3(0.0)));
}

vec3 normal_place(vec3 share) {
    vec3 t = sqrt(-2.0 * log(min(share, 1.0 - share)));
    vec3 place = t - (2.515517 + t * (0.802853 + t * 0.010328))
                   / (1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308)));
    return mix(-place, place, greaterThan(share, vec3(0.5)));
}

// Twin: slope_of().
vec3 slope_of(vec3 filled, vec3 most, vec3 mean) {
    const float root_of_pi = 1.77245385;
    vec3 density = normal_density(mean);
    vec3 little = sqrt(most) / density, nearly_all = density / (root_of_pi * most);
    return min(sqrt(filled) * (little + filled / (1.0 - filled) * nearly_all), STEEPEST);
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
    vec3 changed = base + noise, low = max(base - spread.below, 0.0), high = min(base + spread.above, 1.0);
    vec3 room = min(base - low, high - base) * spread.rate;
    float share = clamp((FREE - min(room.r, min(room.g, room.b))) / (FREE - BOUND), 0.0, 1.0);
    if (share > 0.0) {
        vec3 width = high - low, part = 1.0 / width, deviation = spread.deviation * part;
        vec3 place = clamp((base - low) * part, LEAST_VALUE, 1.0 - LEAST_VALUE);
        vec3 most = place * (1.0 - place), filled = min(deviation * deviation / most, MOST_FILLED);
        vec3 mean = normal_place(place), slope = slope_of(filled * (1.0 - SHARPENED * filled), most, mean);
        vec3 square = slope * slope, wide = 1.0 + square, bend = square / wide;
        mean -= EXCESS / 24.0 * bend * bend * mean * (3.0 - mean * mean);
        vec3 bent = low + width * normal_share(mean * sqrt(wide) + slope * noise * spread.rate);
        changed = mix(changed, bent, share);
    }
    return clamp(changed, 0.0, 1.0);
}
