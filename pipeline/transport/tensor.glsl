// Structure tensors of known pixels: means of gradients over their surface.
// Include transport.glsl before. Twin: structure_tensors() in transport/reference.py, its second half.

#constant TENSOR_REACH_PX
#constant TENSOR_STEP_PX
#constant TENSOR_PX

layout(rgba32f) uniform readonly image2D gradients;

vec3 tensor_at(ivec2 pixel, float guide) {
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
    return total.a > 0.0 ? total.rgb / total.a : vec3(0.0);
}
