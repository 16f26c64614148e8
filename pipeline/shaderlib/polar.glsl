// Place in polar cells of a place on the picture, around a gaze. Twin: compression/grid.py.

#constant WHOLE_TURN     // 1: the last row goes on at the first one
#constant FIRST_RAD      // angle of the first row
#constant LEFT_OUT_RAD   // half of what the arc leaves out

uniform vec2 gaze_px;

const float WHOLE_RAD = 6.28318530717959;

// Angle from the first row, and distance from the gaze in pixels.
vec2 polar_at(vec2 place) {
    vec2 away = place - gaze_px;
    float angle = away == vec2(0.0) ? 0.0 : atan(away.y, away.x);
    return vec2(mod(angle - FIRST_RAD + LEFT_OUT_RAD, WHOLE_RAD) - LEFT_OUT_RAD, length(away));
}

// Columns from where a density starts; it turns where cells begin to grow, beyond a knee.
float columns_at(float radius, float start, float turn, float knee) {
    return min(radius, turn) - start + knee * log(max(radius, turn) / turn);
}
