// The functions of plugins for tests, one point a lane: what the host makes of a BSDF and of a texture.
#define PLUGINS
#include "plugin/given.h"

// numbers: float [PLUGIN_NUMBERS]. points: float [9][count]: wo, wi, u, v, w. results: float [10][count]: f and the density of wi; a direction
// that is sampled; the albedo.
__kernel void plugin_bsdf(__global const float* numbers, __global const float* points, uint plugin, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    vfloat n[16], in[9], pdf;
    for (int k = 0; k < 16; ++k) n[k] = splat(numbers[k]);
    for (int k = 0; k < 9; ++k) in[k] = lane_load(points + (size_t)k * count + at);
    const vec3 wo = vec3_of(in[0], in[1], in[2]), wi = vec3_of(in[3], in[4], in[5]);
    const vec3 f = plugin_eval(splat_uint(plugin), n, wo, wi, &pdf);
    const vec3 sampled = plugin_sample(splat_uint(plugin), n, wo, in[6], in[7], in[8]), albedo = plugin_albedo(splat_uint(plugin), n, wo);
    const vfloat out[10] = {f.x, f.y, f.z, pdf, sampled.x, sampled.y, sampled.z, albedo.x, albedo.y, albedo.z};
    for (int k = 0; k < 10; ++k) lane_save(out[k], results + (size_t)k * count + at);
}

// points: float [5][count]: u, v, and a point of the world. results: float [3][count].
__kernel void plugin_texture(__global const float* numbers, __global const float* points, uint plugin, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    vfloat n[16], in[5];
    for (int k = 0; k < 16; ++k) n[k] = splat(numbers[k]);
    for (int k = 0; k < 5; ++k) in[k] = lane_load(points + (size_t)k * count + at);
    const vec3 c = plugin_value(splat_uint(plugin), n, in[0], in[1], vec3_of(in[2], in[3], in[4]));
    const vfloat out[3] = {c.x, c.y, c.z};
    for (int k = 0; k < 3; ++k) lane_save(out[k], results + (size_t)k * count + at);
}
