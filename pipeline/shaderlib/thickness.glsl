// How far from thin a hole is.
// Twin: _thickness() in shiftmap/base.py. Change both or neither.
//
// The includer names the constants THIN_PX and WIDE_PX.

float thickness(int across_px) {
    return clamp(float(across_px - THIN_PX) / float(WIDE_PX - THIN_PX), 0.0, 1.0);
}
