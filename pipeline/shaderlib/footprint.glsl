// Place of a fragment on a texture, and the level of detail of its pixel and of its pool.

#constant LEVELS  // of pixels: no pool is larger than so many halvings of them

#include "pools.glsl"

in vec2 uv;

uniform ivec2 texture_px;
uniform bool foveated;

// place_px: in the texture's finest texels. rho: logarithm of texels per pixel, as OpenGL picks a
// level of detail. eta: level of detail of the pool, in pixels.
struct Footprint { vec2 place_px; float rho, eta; };

Footprint footprint() {
    vec2 place_px = uv * vec2(texture_px);
    vec2 along_x = dFdx(place_px), along_y = dFdy(place_px);
    float rho = 0.5 * log2(max(dot(along_x, along_x), dot(along_y, along_y)));
    float eta = foveated ? min(lod_of(pool_at(seen_at(gl_FragCoord.xy))), float(LEVELS)) : 0.0;
    return Footprint(place_px, rho, eta);
}
