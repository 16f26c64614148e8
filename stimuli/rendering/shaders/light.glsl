vec3 tone_map(vec3 light) {
    // Reinhard's curve with a white point: soft highlights, shadows as they are.
    const float white = 3.2;
    return light * (1.0 + light / (white * white)) / (1.0 + 0.45 * light);
}

vec3 encode(vec3 light) {
    light = clamp(light, 0.0, 1.0);
    return mix(12.92 * light, 1.055 * pow(light, vec3(1.0 / 2.4)) - 0.055,
               step(0.0031308, light));
}
