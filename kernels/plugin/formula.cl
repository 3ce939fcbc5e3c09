// The formulas of lights of plugins, alone: what they give in given directions, for the power by which lights are sampled, and for
// `clrender furnace`. One direction a lane.
#include "core/exact.h"
#include "core/lane.h"
#include "plugin/given.h"
#include "types.h"

#ifdef PLUGIN_LIGHTS

static void formula_numbers(__global const float* given, vfloat* numbers) {
    for (int i = 0; i < PLUGIN_NUMBERS; ++i) numbers[i] = splat(given[i]);
}

static vec3 formula_at(__global const float* directions, uint count, size_t at) {
    return vec3_of(lane_load(directions + at), lane_load(directions + count + at), lane_load(directions + 2u * count + at));
}

static void formula_put(vec3 v, __global float* results, uint count, size_t at) {
    lane_save(v.x, results + at);
    lane_save(v.y, results + count + at);
    lane_save(v.z, results + 2u * count + at);
}

// given: float [PLUGIN_NUMBERS]. directions: float [3][count], unit. results: float [3][count], W/sr as the plugin says it.
__kernel void formula_intensities(__global const float* given, uint plugin, __global const float* directions, uint count,
                                  __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    vfloat numbers[PLUGIN_NUMBERS];
    formula_numbers(given, numbers);
    formula_put(plugin_said(splat_uint(plugin), numbers, formula_at(directions, count, at)), results, count, at);
}

// results: float [count], per steradian.
__kernel void formula_densities(__global const float* given, uint plugin, float spread, __global const float* directions, uint count,
                                __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    vfloat numbers[PLUGIN_NUMBERS];
    formula_numbers(given, numbers);
    lane_save(plugin_emit_pdf(splat_uint(plugin), numbers, splat(spread), formula_at(directions, count, at)), results + at);
}

// random: float [2][count], from 0 to 1. results: float [3][count], directions.
__kernel void formula_samples(__global const float* given, uint plugin, float spread, __global const float* random, uint count,
                              __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    vfloat numbers[PLUGIN_NUMBERS];
    formula_numbers(given, numbers);
    const vfloat u = lane_load(random + at), v = lane_load(random + count + at);
    formula_put(plugin_emit(splat_uint(plugin), numbers, splat(spread), u, v), results, count, at);
}

#endif
