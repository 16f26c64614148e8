#version 430
// Tensors of the known pixels that hole pixels see: means of gradients over their surface.
// Twin: structure_tensors() in reference.py, its second half. Change both or neither.

#constant TENSOR_REACH_PX
#constant TENSOR_STEP_PX
#constant TENSOR_PX

#include "pixels.glsl"
#include "transport.glsl"

layout(rgba32f) uniform readonly image2D gradients;
layout(std430) buffer Listed { uint listed[]; };

void work(ivec2 pixel, int chain) {
    listed[uint(pixel.y * imageSize(image).x + pixel.x)] = 0u;
    float guide = guide_at(pixel);
    vec4 total = vec4(0.0);
    for (int y = -TENSOR_REACH_PX; y <= TENSOR_REACH_PX; y += TENSOR_STEP_PX) {
        for (int x = -TENSOR_REACH_PX; x <= TENSOR_REACH_PX; x += TENSOR_STEP_PX) {
            ivec2 place = pixel + ivec2(x, y);
            if (!is_inside(place)) continue;
            vec4 product = imageLoad(gradients, place);
            if (product.a < 0.0 || !is_alike(guide, product.a)) continue;
            float weight = exp(-float(x * x + y * y) / (2.0 * TENSOR_PX * TENSOR_PX));
            total += weight * vec4(product.rgb, 1.0);
        }
    }
    imageStore(moved, pixel, vec4(imageLoad(image, pixel).rgb, guide));
    imageStore(tensors, pixel, vec4(total.a > 0.0 ? total.rgb / total.a : vec3(0.0), 0.0));
}
