// Changes fade in beyond the fovea, and are clipped; the fovea is copied.
// Twin: finished() in foveation/reference.py. Needs pools.glsl.

#constant FADE_SHARE  // of the fovea's radius: over it what is changed fades in

vec3 faded(vec3 own, vec3 changed, Place seen) {
    float away = seen.eccentricity_deg - fovea_deg;
    float fade = fovea_deg > 0.0 ? clamp(away / (FADE_SHARE * fovea_deg), 0.0, 1.0) : float(away > 0.0);
    return fade > 0.0 ? clamp(own + fade * (changed - own), 0.0, 1.0) : own;
}
