#version 430
// Weights: what each block of 4x4 pixels multiplies every band's noise by, from the maps of what was
// lost. A call makes 2x2 blocks, which share spectral gains. Twin: wanted_of() in lost.py and
// lost_noise() in foveation/reference.py. Change both or neither.

#constant TILE      // work-group edge, 2x2 blocks
#constant MAP_ROWS  // of each map
#constant MAP_KNEE  // as KNEE_PX in unfold.comp.glsl

#include "polar.glsl"
#include "spectral_gains.glsl"

layout(local_size_x = TILE, local_size_y = TILE) in;

// See weighed_noise.glsl.
layout(rgba16f) uniform writeonly image2DArray weights;
// Maps of a level below one another: deviations in three bands, slopes of Cb and Cr; levels beside
// one another.
uniform sampler2D atlas;
uniform vec3 scales[LEVELS];
uniform vec3 places[LEVELS];  // first column, columns, where the map starts in pixels

struct Block { vec3 variance; vec2 slope; };

Block cell_at(int level, ivec2 cell) {  // column, row
    int columns = int(places[level].y), first = int(places[level].x);
    int row = WHOLE_TURN == 1 ? (cell.y + MAP_ROWS) % MAP_ROWS : clamp(cell.y, 0, MAP_ROWS - 1);
    ivec2 at = ivec2(first + clamp(cell.x, 0, columns - 1), row), next = ivec2(0, MAP_ROWS);
    vec3 deviation = scales[level] * vec3(texelFetch(atlas, at, 0).r, texelFetch(atlas, at + next, 0).r,
                                          texelFetch(atlas, at + 2 * next, 0).r);
    vec2 slope = vec2(texelFetch(atlas, at + 3 * next, 0).r, texelFetch(atlas, at + 4 * next, 0).r);
    return Block(deviation * deviation, 2.0 * slope - 1.0);
}

Block block_at(int level, ivec2 block) {
    vec2 polar = polar_at(4.0 * (vec2(block) + 0.5));
    float start = places[level].z;
    float column = columns_at(polar.y, start, max(start, MAP_KNEE), MAP_KNEE);
    vec2 at = vec2(column, polar.x * MAP_KNEE) - 0.5, corner = floor(at), part = at - corner;
    ivec2 cell = ivec2(corner);
    Block a = cell_at(level, cell), b = cell_at(level, cell + ivec2(1, 0));
    Block c = cell_at(level, cell + ivec2(0, 1)), d = cell_at(level, cell + 1);
    vec3 variance = mix(mix(a.variance, b.variance, part.x), mix(c.variance, d.variance, part.x), part.y);
    vec2 slope = mix(mix(a.slope, b.slope, part.x), mix(c.slope, d.slope, part.x), part.y);
    return Block(clamp(column, 0.0, 1.0) * variance, slope);
}

ivec2 last;

vec3 asked_at(int level, ivec2 first) {
    vec3 sum = vec3(0.0);
    for (int k = 0; k < 4; ++k) sum += block_at(level, min(first + ivec2(k & 1, k >> 1), last)).variance;
    return 0.25 * sum;
}

void main() {
    ivec2 first = 2 * ivec2(gl_GlobalInvocationID.xy);
    last = imageSize(weights).xy - 1;
    if (any(greaterThan(first, last))) return;
    for (int level = 0; level < LEVELS; ++level) asked[level] = asked_at(level, first);
    find_gains();
    float deviation = deviation_of_all();
    for (int k = 0; k < 4; ++k) {
        ivec2 block = first + ivec2(k & 1, k >> 1);
        if (any(greaterThan(block, last))) continue;
        float scalars[LEVELS + 4];
        for (int level = 0; level < LEVELS; ++level) {
            Block own = block_at(level, block);
            imageStore(weights, ivec3(block, level), vec4(sqrt(own.variance) * gains[level], own.slope.x));
            scalars[level] = own.slope.y;
        }
        scalars[LEVELS] = deviation;
        for (int i = 0; i <= LEVELS; i += 4)
            imageStore(weights, ivec3(block, LEVELS + i / 4),
                       vec4(scalars[i], scalars[i + 1], scalars[i + 2], scalars[i + 3]));
    }
}
