// Depth-guided pull and push.
// Twin: pull(), push(), interpolate() in inpaint/reference.py. Change both or neither.
//
// Texels of chains are laid out by planes.glsl. The guide is an image of its own: all chains
// share it.
//
// Lessons of Mesa's software renderer: no local arrays here or in the passes (one that is
// not unrolled lives in memory, 10x slower), no loops (2x), no texture layers (they lie a
// power of two apart and push each other out of the cache, 3x), images rather than buffers
// for what is read more often than written (a buffer is read lane by lane).

#define ONLY_NEARER (-1.0)

uniform float depth_threshold;

// Shares of four children in their parent.
struct Pull {
    vec4 share;        // of each child; sums to 1, or 0 if nothing is known
    float confidence;  // the parent's validity
};

// `deepest`: the farthest of the four guides.
Pull pull_shares(vec4 validity, vec4 guide, float deepest) {
    vec4 behind = vec4(lessThanEqual(deepest - guide, vec4(depth_threshold)));
    vec4 weight = behind * max(validity, 0.0);
    float total = dot(weight, vec4(1.0));
    float confidence = 0.25 * total;
    if (total <= 0.0) {
        weight = vec4(notEqual(validity, vec4(0.0)));
        total = dot(weight, vec4(1.0));
        confidence = total > 0.0 ? ONLY_NEARER : 0.0;
    }
    return Pull(total > 0.0 ? weight / total : vec4(0.0), confidence);
}

// Shares of four neighbours in a pixel: those of its own depth count; where none is, those
// not nearer. Twin: guided_mean() in inpaint/reference.py.
struct Shares {
    vec4 share;    // sums to 1, or 0 if all are nearer
    bool similar;  // whether one of the pixel's own depth was found
};

Shares guided_shares(vec4 bilinear, float guide, vec4 guides) {
    vec4 difference = guide - guides;
    vec4 not_nearer = bilinear * vec4(lessThanEqual(difference, vec4(depth_threshold)));
    vec4 share = not_nearer * vec4(lessThanEqual(-difference, vec4(depth_threshold)));
    float total = dot(share, vec4(1.0));
    bool similar = total > 0.0;
    if (!similar) {
        share = not_nearer;
        total = dot(share, vec4(1.0));
    }
    return Shares(total > 0.0 ? share / total : vec4(0.0), similar);
}

// Of a pixel's own parent and the next ones in x, in y and in both.
Shares push_shares(float guide, vec4 guides) {
    return guided_shares(vec4(9.0, 3.0, 3.0, 1.0), guide, guides);
}

// Of the next pixels to the left, right, above and below, for a relaxation: those of its own depth
// alone. Sums to 1, or 0 if there are none. Twin: relax() in inpaint/reference.py.
vec4 relax_shares(float guide, vec4 guides) {
    vec4 share = vec4(lessThanEqual(abs(guide - guides), vec4(depth_threshold)));
    float total = dot(share, vec4(1.0));
    return total > 0.0 ? share / total : vec4(0.0);
}

// Share that a texel keeps of itself: validity ** gamma, and 0 stays 0 at every gamma; all,
// where nothing of its depth lies below. Give gamma as a constant, and the driver folds the choice:
// left open, every pixel takes the power as well.
float kept(float validity, float gamma, bool similar) {
    if (validity <= 0.0) return 0.0;
    if (!similar || gamma == 0.0) return 1.0;
    if (gamma == 0.25) return sqrt(sqrt(validity));
    if (gamma == 0.5) return sqrt(validity);
    if (gamma == 1.0) return validity;
    return pow(validity, gamma);
}

vec4 mixed(vec4 share, vec4 a, vec4 b, vec4 c, vec4 d) {
    return share.x * a + share.y * b + share.z * c + share.w * d;
}

float farthest(vec4 guide) { return max(max(guide.x, guide.y), max(guide.z, guide.w)); }

float nearest(vec4 guide) { return min(min(guide.x, guide.y), min(guide.z, guide.w)); }
