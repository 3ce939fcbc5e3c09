// Entry point that finds how the lights light each patch: the mean over random points of it.
#include "radiosity/direct.h"
#include "radiosity/patch.h"

#define DIRECT_SEED 0x6a09e667u        // other random numbers than those of the form factors

// irradiance: float [count][3] W/m², of rows from `first` on. seen: a bit for each of at most 32 samples, set where nothing hid the
// light. With `update`, `seen` is believed where the shadow ray passes neither of two boxes (low, high, low, high) and the side is
// not one of [moved, moved_end).
__kernel void radiosity_direct(SCENE_PARAMETERS __global const uint* sides, uint first, uint count, uint samples, uint update,
                               uint moved, uint moved_end, __global const float* boxes, __global uint* seen,
                               __global float* irradiance) {
    SCENE_COLLECT(scene);
    const uint base = (uint)get_global_id(0) * LANES;
    if (base >= count) return;
    uint number[LANES], bits[LANES];
    int real[LANES];
    float red[LANES], green[LANES], blue[LANES];
    for (uint lane = 0; lane < LANES; ++lane) {
        real[lane] = base + lane < count;
        const uint n = first + (real[lane] ? base + lane : base);
        number[lane] = sides[n];
        bits[lane] = update ? seen[n] : 0u;
    }
    const vmask active = lane_restore(real) != 0;
    const vuint side = lane_restore(number), before = lane_restore(bits);
    const vmask believed = (side < moved) | (side >= moved_end);
    vuint now = splat_uint(0u);
    vec3 sum = vec3_all(0.0f);
    for (uint sample = 0; sample < samples; ++sample) {
        const Sampler sampler = sampler_start(settings->seed ^ DIRECT_SEED, side, splat_uint(sample));
        vfloat u, v;
        vuint bits_u, bits_v;
        sampler_get(sampler, SET_PIXEL, &u, &v);
        const Surface s = patch_point(&scene, side, u, v);
        sampler_bits(sampler, splat_uint(SET_LIGHT), &bits_u, &bits_v);
        const DirectSample direct = direct_sample(&scene, &s, s.normal, bits_u, bits_v);
        const vmask asked = active & (largest(direct.irradiance) > 0.0f);
        vmask traced = asked;
        if (update) traced = asked & (!believed | patch_passes_box(&direct.ray, boxes) | patch_passes_box(&direct.ray, boxes + 6));
        vmask free = (before & (1u << sample)) != 0u;
        if (lane_any(traced)) {
            const vmask blocked = traverse_occluded(&scene.bvh, &direct.ray, traced);
            free = traced ? !blocked : free;
        }
        free = asked & free;
        now = now | (free ? splat_uint(1u << sample) : splat_uint(0u));
        sum = choose(free, add(sum, direct.irradiance), sum);
    }
    sum = scale(sum, splat(1.0f) / (float)samples);
    lane_store(now, bits);
    lane_store(sum.x, red);
    lane_store(sum.y, green);
    lane_store(sum.z, blue);
    for (uint lane = 0; lane < LANES; ++lane) {
        if (!real[lane]) continue;
        __global float* out = irradiance + (size_t)(first + base + lane) * 3;
        seen[first + base + lane] = bits[lane];
        out[0] = red[lane], out[1] = green[lane], out[2] = blue[lane];
    }
}
