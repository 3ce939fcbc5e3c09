// Where a pixel filter puts samples, for tests: one in every lane.
#include "core/sampler.h"
#include "film/filter.h"

// bits: uint [2][count]. results: float [3][count]: the place, from the pixel's upper left corner, and 1 where the filter is negative.
__kernel void filter_places(__global const float* bits, __global const Settings* settings, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    vfloat u = unit_interval(vfloat_bits(lane_load(bits + at))), v = unit_interval(vfloat_bits(lane_load(bits + count + at)));
    const vmask negative = filter_place(settings, &u, &v);
    lane_save(u, results + at);
    lane_save(v, results + count + at);
    lane_save((negative ? splat(1.0f) : splat(0.0f)), results + 2 * (size_t)count + at);
}
