#version 430
// Tensors of the known pixels that hole pixels see.
// Twin: structure_tensors() in reference.py. Change both or neither.

#include "pixels.glsl"
#include "transport.glsl"
#include "transport/tensor.glsl"

layout(std430) buffer Listed { uint listed[]; };

void work(ivec2 pixel, int chain) {
    listed[uint(pixel.y * imageSize(image).x + pixel.x)] = 0u;
    float guide = guide_at(pixel);
    imageStore(moved, pixel, vec4(imageLoad(image, pixel).rgb, guide));
    imageStore(tensors, pixel, vec4(tensor_at(pixel, guide), 0.0));
}
