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

// Add normal noise of this deviation to R'G'B', to lead no farther below and above. Where there is
// none, the base stays as it is.
vec3 added(vec3 base, vec3 noise, vec3 deviation, vec3 below, vec3 above) {
    if (noise == vec3(0.0)) return base;
    deviation = sqrt(deviation * deviation + SMALLEST_VARIANCE);
    vec3 changed = base + noise, low = max(base - below, 0.0), width = min(base + above, 1.0) - low;
    vec3 place = (base - low) / width, spread = deviation / width, room = min(place, 1.0 - place) / spread;
    float share = clamp((FREE - min(room.r, min(room.g, room.b))) / (FREE - BOUND), 0.0, 1.0);
    if (share > 0.0) {
        place = clamp(place, LEAST_VALUE, 1.0 - LEAST_VALUE);
        vec3 most = place * (1.0 - place), filled = min(spread * spread / most, MOST_FILLED);
        vec3 mean = normal_place(place), slope = slope_of(filled * (1.0 - SHARPENED * filled), most, mean);
        vec3 square = slope * slope, wide = 1.0 + square, part = square / wide;
        mean -= EXCESS / 24.0 * part * part * mean * (3.0 - mean * mean);
        vec3 bent = low + width * normal_share(mean * sqrt(wide) + slope * noise / deviation);
        changed = mix(changed, bent, share);
    }
    return clamp(changed, 0.0, 1.0);
}
