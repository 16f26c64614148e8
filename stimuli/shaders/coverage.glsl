bool uncovered(vec2 uv, float alpha) {
    // Coarse mip levels average coverage away; give it back, or leaves thin out far off.
    float level = max(0.0, textureQueryLod(albedo, uv).x);
    return alpha * (1.0 + 0.25 * level) < 0.5;
}
