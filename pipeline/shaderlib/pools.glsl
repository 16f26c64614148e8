// Width of the eye's pools at a place, as the share of each level of detail.
// Twin: geometry.py and pooling.py in foveation/. Change both or neither.

#constant PROJECTION       // 0: a flat picture, 1: a whole panorama, 2: a pole of one; see geometry.py
#constant POWER            // of the eccentricity in the pooling law: 1 or 2
#constant HALVED_VARIANCE  // of a halving and a doubling, over 3: see pooling.py

uniform vec2 picture_px;    // width, height
#if PROJECTION == 0
uniform vec2 centre_px;     // where the normal through the eye meets the picture
uniform float distance_px;
#elif PROJECTION == 1
uniform float least_cosine; // of the latitude
#else
uniform float radian_px;    // pixels of a radian at the pole
uniform float pole;         // y of its direction
#endif
uniform vec3 gaze;          // unit vector from the eye
uniform float slope;        // of the law, degrees
uniform float fovea_deg;

const float PI = 3.14159265358979;

// Place of a picture before the eye: its direction, its angle from the gaze, and the pixels of a square degree
// there.
struct Place {
    vec3 ray;
    float eccentricity_deg, square_deg_px;
};

Place seen_at(vec2 at) {
#if PROJECTION == 0
    vec3 ray = vec3(at - centre_px, distance_px);
    float per_deg = radians(1.0) * distance_px, secant = length(ray) / distance_px;
    float square_deg_px = per_deg * per_deg * secant * secant * secant;
#elif PROJECTION == 1
    float longitude = (at.x / picture_px.x - 0.5) * (2.0 * PI);
    float latitude = (0.5 - at.y / picture_px.y) * PI;
    float level = cos(latitude);
    vec3 ray = vec3(sin(longitude) * level, -sin(latitude), cos(longitude) * level);
    float per_deg = picture_px.x / 360.0;
    float square_deg_px = per_deg * per_deg / max(level, least_cosine);
#else
    vec2 from_pole = (at - 0.5 * picture_px) / (2.0 * radian_px);
    float square = dot(from_pole, from_pole);
    vec3 ray = vec3(2.0 * from_pole.x, pole * (1.0 - square), -pole * 2.0 * from_pole.y) / (1.0 + square);
    float per_deg = radians(1.0) * radian_px * (1.0 + square);
    float square_deg_px = per_deg * per_deg;
#endif
    float angle = atan(length(cross(ray, gaze)), dot(ray, gaze));
    return Place(ray, degrees(angle), square_deg_px);
}

float law(float eccentricity_deg) {
    float square = eccentricity_deg * eccentricity_deg;
    return POWER == 2 ? square * square : square;
}

// Variance of the pool over HALVED_VARIANCE, pixels squared.
float pool_at(Place place) {
    float beyond = law(max(place.eccentricity_deg, fovea_deg)) - law(fovea_deg);
    return slope * slope * beyond * place.square_deg_px / HALVED_VARIANCE;
}

// clamp(lod - n, 0, 1), for the level of detail of a pool.
float beyond_lod(float pool, int n) {
    float power = exp2(float(2 * n));
    return clamp((pool - (power - 1.0)) / (3.0 * power), 0.0, 1.0);
}

// Level of detail of a pool.
float lod_of(float pool) {
    float level = floor(0.5 * log2(pool + 1.0)), power = exp2(2.0 * level);
    return level + (pool - (power - 1.0)) / (3.0 * power);
}
