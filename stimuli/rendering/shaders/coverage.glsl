bool uncovered(vec2 uv, float alpha) {
    // Coarse mip levels average coverage away; give it back, or leaves thin out far off.
    float level = max(0.0, textureQueryLod(albedo, uv).x);
    return alpha * (1.0 + 0.25 * level) < 0.5;
}

// A texture's texel. Where a whole triangle has one place on the texture, its footprint is a point,
// and nothing is filtered: Mesa 25's software renderer divides by the footprint's length, and drew
// such surfaces black. (textureLod, which would say the same, never ends in Mesa 22's.)
vec4 texel_at(sampler2D picture, vec2 place) {
    vec4 found = texture(picture, place);
    if (dFdx(place) == vec2(0.0) && dFdy(place) == vec2(0.0)) {
        ivec2 size = textureSize(picture, 0);
        vec2 within = mix(fract(place), clamp(place, 0.0, 1.0), vec2(clamped));
        found = texelFetch(picture, min(ivec2(within * vec2(size)), size - 1), 0);
    }
    return found;
}
