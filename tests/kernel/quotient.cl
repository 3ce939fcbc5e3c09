// Divisions and square roots as core/quotient.h makes them, in LANES lanes, alone and in eights.
#include "core/quotient.h"

__kernel void quotients(__global const float* a, __global const float* b, __global float* divided, __global float* roots) {
    const size_t at = get_global_id(0) * LANES;
    lane_save(quotient(lane_load(a + at), lane_load(b + at)), divided + at);
    lane_save(square_root(lane_load(a + at)), roots + at);
}

__kernel void quotients_one(__global const float* a, __global const float* b, __global float* divided) {
    const size_t at = get_global_id(0);
    divided[at] = quotient_one(a[at], b[at]);
}

__kernel void quotients_pack(__global const float* a, __global const float* b, __global float* divided, __global float* roots) {
    const size_t at = get_global_id(0);
    vstore8(quotient_pack(vload8(at, a), vload8(at, b)), at, divided);
    vstore8(square_root_pack(vload8(at, a)), at, roots);
}
