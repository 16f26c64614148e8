// Noise kept on the display. Twin: foveation/bounded.py. Change both or neither.

#constant FREE               // deviations from the nearer end of the display, see bounded.py
#constant BOUND
#constant LEAST_LUMA         // of a base, from either end
#constant MOST_FILLED        // of the variance of black and white without grey
#constant STEEPEST
#constant SHARPENED          // share of the variance that is left out at most
#constant SMALLEST_VARIANCE

#include "ycbcr.glsl"

// The normal distribution function (Abramowitz and Stegun 1964, 7.1.26).
float normal_share(float z) {
    float t = 1.0 / (1.0 + 0.3275911 * 0.70710678 * abs(z));
    float tail = 0.5 * exp(-0.5 * z * z) * t
               * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))));
    return z < 0.0 ? tail : 1.0 - tail;
}

// Its inverse, from LEAST_LUMA to 1 - LEAST_LUMA (Giles 2010).
float normal_place(float share) {
    float w = -log(4.0 * share * (1.0 - share));
    float p;
    if (w < 5.0) {
        w -= 2.5;
        p = 2.81022636e-08;
        p = 3.43273939e-07 + p * w;
        p = -3.5233877e-06 + p * w;
        p = -4.39150654e-06 + p * w;
        p = 0.00021858087 + p * w;
        p = -0.00125372503 + p * w;
        p = -0.00417768164 + p * w;
        p = 0.246640727 + p * w;
        p = 1.50140941 + p * w;
    } else {
        w = sqrt(w) - 3.0;
        p = -0.000200214257;
        p = 0.000100950558 + p * w;
        p = 0.00134934322 + p * w;
        p = -0.00367342844 + p * w;
        p = 0.00573950773 + p * w;
        p = -0.0076224613 + p * w;
        p = 0.00943887047 + p * w;
        p = 1.00167406 + p * w;
        p = 2.83297682 + p * w;
    }
    return 1.41421356 * p * (2.0 * share - 1.0);
}

// Twin: slope_of().
float slope_of(float filled, float most, float mean) {
    const float root_of_two_pi = 2.50662827, root_of_pi = 1.77245385;
    float density = exp(-0.5 * mean * mean) / root_of_two_pi;
    float little = sqrt(most) / density, nearly_all = density / (root_of_pi * most);
    return min(sqrt(filled) * (little + filled / (1.0 - filled) * nearly_all), STEEPEST);
}

// Luma with its noise, which has this deviation.
float bounded(float base, float noise, float deviation) {
    float variance = deviation * deviation + SMALLEST_VARIANCE;
    deviation = sqrt(variance);
    float room = min(base, 1.0 - base), share = clamp((FREE - room / deviation) / (FREE - BOUND), 0.0, 1.0);
    float luma = base + noise;
    if (share > 0.0) {
        float at = clamp(base, LEAST_LUMA, 1.0 - LEAST_LUMA), most = at * (1.0 - at);
        float filled = min(variance / most, MOST_FILLED), mean = normal_place(at);
        float slope = slope_of(filled * (1.0 - SHARPENED * filled), most, mean);
        float bent = normal_share(mean * sqrt(1.0 + slope * slope) + slope * noise / deviation);
        luma = mix(luma, bent, share);
    }
    return clamp(luma, 0.0, 1.0);
}

// R'G'B' of a luma, and of as much chroma as it can have.
vec3 in_gamut(float luma, vec2 chroma) {
    vec3 away = RGB_FROM_YCBCR * vec3(0.0, chroma);
    vec3 room = mix(vec3(luma), vec3(1.0 - luma), greaterThan(away, vec3(0.0)));
    vec3 share = min(room / max(abs(away), 1e-12), 1.0);
    return luma + min(share.r, min(share.g, share.b)) * away;
}

// Add noise, Y'CbCr, to R'G'B'. Where there is none, the base stays as it is.
vec3 added(vec3 base, vec3 noise, float deviation) {
    if (noise == vec3(0.0)) return base;
    vec3 ycc = YCBCR_FROM_RGB * base;
    return in_gamut(bounded(ycc.x, noise.x, deviation), ycc.yz + noise.yz);
}
