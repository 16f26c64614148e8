#version 430
// Depth alone, of what has no gaps: nothing is asked of a pixel, which is many times faster.

void main() {
}
