// Entry point that finds how the lights light each patch: the mean over random points of it.
#include "radiosity/direct.h"
#include "radiosity/moving.h"

#define DIRECT_SEED 0x6a09e667u        // other random numbers than those of the form factors

// Whether shadow rays from a patch to a light may pass where the shape that moved was or is. light_boxes: low and high of each light.
static vmask direct_may_change(const Scene* scene, const Moving* moving, vuint side, __global const float* light_boxes, uint lights) {
    const PatchBox from = moving_patch_box(scene, side);
    vmask may = moving_has(moving, side);
    for (uint light = 0; light < lights; ++light) {
        PatchBox to;
        for (int axis = 0; axis < 3; ++axis) {
            to.low[axis] = splat(light_boxes[light * 6u + axis]);
            to.high[axis] = splat(light_boxes[light * 6u + 3u + axis]);
        }
        may = may | moving_between(&from, &to, moving->place + MOVING_BEFORE) |
              moving_between(&from, &to, moving->place + MOVING_AFTER);
    }
    return may;
}

// irradiance: float [count][3] W/m², of rows from `first` on. seen: a bit for each of at most 32 samples, set where nothing hid the
// light. With `lights`, both are believed of sides that the move cannot have changed, and `seen` where the shadow ray passes neither
// of the places of the shape.
__kernel void radiosity_direct(SCENE_PARAMETERS MOVING_PARAMETERS __global const uint* sides, uint first, uint count, uint samples,
                               __global const float* light_boxes, uint lights, __global uint* seen, __global float* irradiance) {
    SCENE_COLLECT(scene);
    MOVING_COLLECT(moving);
    const uint base = (uint)get_global_id(0) * LANES;
    if (base >= count) return;
    uint number[LANES], bits[LANES];
    int real[LANES];
    float red[LANES], green[LANES], blue[LANES];
    for (uint lane = 0; lane < LANES; ++lane) {
        real[lane] = base + lane < count;
        const uint n = first + (real[lane] ? base + lane : base);
        number[lane] = sides[n];
        bits[lane] = lights ? seen[n] : 0u;
    }
    const vmask active = lane_restore(real) != 0;
    const vuint side = lane_restore(number), before = lane_restore(bits);
    if (lights && !lane_any(active & direct_may_change(&scene, &moving, side, light_boxes, lights))) return;
    const vmask believed = !moving_has(&moving, side);
    const uint trees = moved < moved_end ? 2u : 1u;
    vuint now = splat_uint(0u);
    vec3 sum = vec3_all(0.0f);
    for (uint sample = 0; sample < samples; ++sample) {
        const Sampler sampler = sampler_start(settings->seed ^ DIRECT_SEED, side, splat_uint(sample));
        vfloat u, v;
        sampler_get(sampler, SET_PIXEL, &u, &v);
        const Surface s = patch_point(&scene, side, u, v);
        const DirectSample direct = direct_sample(&scene, &s, s.normal, sampler);
        const vmask asked = active & (largest(direct.irradiance) > 0.0f);
        vmask traced = asked;
        if (lights)
            traced = asked & (!believed | moving_passes_box(&direct.ray, place + MOVING_BEFORE) |
                              moving_passes_box(&direct.ray, place + MOVING_AFTER));
        vmask free = asked & (traced | ((before & (1u << sample)) != 0u));
        Bvh tree = scene.bvh;
        Ray ray = direct.ray;
        for (uint turn = 0; turn < trees && lane_any(traced); ++turn) {
            const vmask blocked = traverse_occluded(&tree, &ray, traced);
            free = free & !blocked;
            traced = traced & !blocked;
            tree = moving.tree;
            if (trees > 1u) ray = moving_ray(&moving, &direct.ray);
        }
        now = now | (free ? splat_uint(1u << sample) : splat_uint(0u));
        sum = choose(free, add(sum, direct.irradiance), sum);
    }
    sum = scale(sum, quotient(splat(1.0f), splat((float)samples)));
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
