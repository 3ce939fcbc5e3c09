// What tests ask of lamps: directions for photons, and intensities in given directions.
#include "light/lamp.h"
#include "scene.h"

// Of the light `number`. bits: uint [2][count], of which u and v are made. results: float [5][count]: direction, density, and the first
// channel of the intensity there.
__kernel void lamp_samples(SCENE_PARAMETERS __global const float* bits, uint number, uint count, __global float* results) {
    SCENE_COLLECT(scene);
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const vfloat u = vfloat_of(vint_from_uint(vfloat_bits(lane_load(bits + at)) >> 8)) * 5.9604645e-8f;
    const vfloat v = vfloat_of(vint_from_uint(vfloat_bits(lane_load(bits + count + at)) >> 8)) * 5.9604645e-8f;
    const LightRow l = light_at(&scene, splat_uint(number), splat(0.0f));
    vfloat pdf;
    const vec3 d = lamp_sample(&scene, &l, u, v, &pdf);
    lane_save(d.x, results + at);
    lane_save(d.y, results + count + at);
    lane_save(d.z, results + (size_t)2 * count + at);
    lane_save(pdf, results + (size_t)3 * count + at);
    lane_save(lamp_intensity(&scene, &l, d).x, results + (size_t)4 * count + at);
}

// numbers: float [3][count], unit directions. results: float [1][count]: the intensity.
__kernel void lamp_looks(SCENE_PARAMETERS __global const float* numbers, uint number, uint count, __global float* results) {
    SCENE_COLLECT(scene);
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    vec3 d;
    d.x = lane_load(numbers + at), d.y = lane_load(numbers + count + at), d.z = lane_load(numbers + (size_t)2 * count + at);
    const LightRow l = light_at(&scene, splat_uint(number), splat(0.0f));
    lane_save(lamp_intensity(&scene, &l, d).x, results + at);
}
