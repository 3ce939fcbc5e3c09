// What tests ask of the environment: samples of it, and what there is in given directions.
#include "light/environment.h"
#include "scene.h"

// numbers: uint [2][count], of which u and v are made. results: float [11][count]: direction, radiance and density of a sample; then
// radiance in that direction, and the density with which it would have been sampled.
__kernel void environment_samples(SCENE_PARAMETERS __global const float* numbers, uint count, __global float* results) {
    SCENE_COLLECT(scene);
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const vfloat u = vfloat_of(vint_from_uint(vfloat_bits(lane_load(numbers + at)) >> 8)) * 5.9604645e-8f;
    const vfloat v = vfloat_of(vint_from_uint(vfloat_bits(lane_load(numbers + count + at)) >> 8)) * 5.9604645e-8f;
    const EnvironmentSample s = environment_sample(&scene, vec3_all(0.0f), u, v);
    const EnvironmentSample again = environment_along(&scene, vec3_all(0.0f), s.direction);
    vfloat out[11];
    out[0] = s.direction.x, out[1] = s.direction.y, out[2] = s.direction.z;
    out[3] = s.radiance.x, out[4] = s.radiance.y, out[5] = s.radiance.z;
    out[6] = s.pdf;
    out[7] = again.radiance.x, out[8] = again.radiance.y, out[9] = again.radiance.z;
    out[10] = again.pdf;
    for (int k = 0; k < 11; ++k) lane_save(out[k], results + (size_t)k * count + at);
}

// numbers: float [3][count], directions. results: float [4][count]: radiance, and atan2(x, -z) in turns.
__kernel void environment_looks(SCENE_PARAMETERS __global const float* numbers, uint count, __global float* results) {
    SCENE_COLLECT(scene);
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    vec3 d;
    d.x = lane_load(numbers + at), d.y = lane_load(numbers + count + at), d.z = lane_load(numbers + (size_t)2 * count + at);
    const vec3 radiance = environment_along(&scene, vec3_all(0.0f), d).radiance;
    lane_save(radiance.x, results + at);
    lane_save(radiance.y, results + count + at);
    lane_save(radiance.z, results + (size_t)2 * count + at);
    lane_save(turn_of(-d.z, d.x), results + (size_t)3 * count + at);
}
