bool uncovered(vec2 uv, float alpha) {
    // Coarse mip levels average coverage away; give it back, or leaves thin out far off.
    float level = max(0.0, textureQueryLod(albedo, uv).x);
    return alpha * (1.0 + 0.25 * level) < 0.5;
}

// The texture's texel. Where a whole triangle has one place on the texture, its footprint is a point,
// and nothing is filtered: Mesa 25's software renderer divides by the footprint's length, and drew
// such surfaces black. (textureLod, which would say the same, never ends in Mesa 22's.)
vec4 texel_at(vec2 place) {
    vec4 found = texture(albedo, place);
    if (dFdx(place) == vec2(0.0) && dFdy(place) == vec2(0.0)) {
        ivec2 size = textureSize(albedo, 0);
        found = texelFetch(albedo, min(ivec2(fract(place) * vec2(size)), size - 1), 0);
    }
    return found;
}
