#version 430
// Add one level's noise, weighed by its deviations, in hole pixels.
// Twin: at_pixels(), noise_texels() and printed_fill() in reference.py. Change both or neither.

#constant TILE             // work-group edge, pixels
#constant NOISE_TILE       // edge of the noise's tile, a power of two
#constant ANCHOR_REACH_PX  // beyond it noise stays on the screen

layout(local_size_x = TILE, local_size_y = TILE) in;

layout(rgba32f) uniform image2D ycbcr;            // the sum so far
layout(rgba32f) uniform readonly image2D planes;  // means side by side, squares below
layout(rgba32f) uniform readonly image2D noise;   // bands side by side, levels below
layout(rg32f) uniform readonly image2D flow_px;
layout(rgba32f) uniform readonly image2D image;   // a: 1 known, 0 hole

uniform int level;
uniform ivec2 level_size;  // of one plane

vec3 deviation(ivec2 pixel, int index) {
    ivec2 at = pixel + ivec2(index * level_size.x, 0);
    vec3 mean = imageLoad(planes, at).rgb;
    vec3 second = imageLoad(planes, at + ivec2(0, level_size.y)).rgb;
    return sqrt(max(second - mean * mean, vec3(0.0)));
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, imageSize(ycbcr)))) return;
    if (imageLoad(image, pixel).a > 0.0) return;
    vec2 here = vec2(pixel) + 0.5;
    vec2 from = here - imageLoad(flow_px, pixel).xy;
    if (!all(lessThan(abs(from), vec2(ANCHOR_REACH_PX)))) from = here;
    ivec2 texel = ivec2(floor(from)) & (NOISE_TILE - 1);

    vec2 place = here / float(1 << level) - 0.5;
    ivec2 first = ivec2(floor(place)), last = level_size - 1;
    vec2 share = place - vec2(first);
    ivec2 a = clamp(first, ivec2(0), last), b = clamp(first + 1, ivec2(0), last);
    vec3 sum = vec3(0.0);
    for (int index = 0; index < 3; ++index) {
        vec3 above = mix(deviation(a, index), deviation(ivec2(b.x, a.y), index), share.x);
        vec3 below = mix(deviation(ivec2(a.x, b.y), index), deviation(b, index), share.x);
        ivec2 at = texel + ivec2(index, level) * NOISE_TILE;
        sum += mix(above, below, share.y) * imageLoad(noise, at).rgb;
    }
    imageStore(ycbcr, pixel, imageLoad(ycbcr, pixel) + vec4(sum, 0.0));
}
