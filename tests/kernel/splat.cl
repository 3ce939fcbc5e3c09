// Adds numbers to the sums of splats, a work-item each.
#include "film/splat.h"

__kernel void add_splats(__global const float* values, __global const uint* slots, uint count, uint slot_count, __global uint* sums) {
    const uint i = (uint)get_global_id(0);
    if (i * LANES >= count) return;
    Splats splats;
    splats.sums = sums;
    splats.first_slot = 0u;
    splats.slot_count = slot_count;
    const vfloat x = lane_load(values + i * LANES), y = x * 0.5f;
    splat_add(&splats, lane_load(slots + i * LANES), vec3_of(x, y, -x), mask_all(), splat_uint(0u), splat_uint(0u), splat(0.0f));
}
