// Shares and displacements common to the pictures of a panorama. Twin: foveation/sphere.py.
// Change both or neither.

#constant BELT_SINE  // of the latitude to which a panorama is itself
#constant CAP_SINE   // and of that from which on it is the picture of its pole

float cap_share(vec3 ray) { return smoothstep(BELT_SINE, CAP_SINE, abs(ray.y)); }

// By how much noise that is mixed with other noise has to be stronger.
float noise_strength(vec3 ray) {
    float share = cap_share(ray);
    return inversesqrt(share * share + (1.0 - share) * (1.0 - share));
}
