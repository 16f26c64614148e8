// Noise interpolated between four places: their shares, and the variance that it keeps.
// Twin: look_up() in noise/tile.py. Change both or neither.

// Of the places (0, 0), (1, 0), (0, 1) and (1, 1), for a place between them.
vec4 bilinear(vec2 fraction) {
    vec2 rest = 1.0 - fraction;
    return vec4(rest.x * rest.y, fraction.x * rest.y, rest.x * fraction.y, fraction.x * fraction.y);
}

// Of unit noise with this correlation at the lags (0, 1), (1, 0), (1, 1) and (1, -1) in rows and columns.
float kept_variance(vec4 share, vec4 lag_correlation) {
    vec4 lag = 2.0 * vec4(share.x * share.y + share.z * share.w, share.x * share.z + share.y * share.w,
                          share.x * share.w, share.y * share.z);
    return dot(share, share) + dot(lag, lag_correlation);
}
