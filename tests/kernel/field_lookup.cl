// guiding/field.h alone: samples of a histogram with their densities, densities of given directions, and places of points.
#include "core/exact.h"
#include "core/lane.h"
#include "guiding/field.h"

static vuint at_lanes(__global const uint* values) { return lane_load((__global const uint*)values + get_global_id(0) * LANES); }
static vfloat numbers_at_lanes(__global const float* values) { return lane_load(values + get_global_id(0) * LANES); }

// bits: [2][count]; directions: [3][count]; densities, bins: [count]
__kernel void sample_field(__global const uint* nodes, __global const uint* cells, float4 frame, uint cell, uint count, __global const uint* bits,
                           __global float* directions, __global float* densities, __global uint* bins) {
    const Field field = {nodes, cells, frame};
    const size_t first = get_global_id(0) * LANES;
    const vec3 direction = field_sample(&field, splat_uint(cell), at_lanes(bits), at_lanes(bits + count));
    vfloat steps;
    lane_save(direction.x, directions + first);
    lane_save(direction.y, directions + count + first);
    lane_save(direction.z, directions + 2 * count + first);
    lane_save(field_pdf(&field, splat_uint(cell), direction), densities + first);
    lane_save(field_bin(direction, &steps), bins + first);
}

__kernel void density_of_field(__global const uint* nodes, __global const uint* cells, float4 frame, uint cell, uint count,
                               __global const float* directions, __global float* densities) {
    const Field field = {nodes, cells, frame};
    const vfloat x = numbers_at_lanes(directions), y = numbers_at_lanes(directions + count), z = numbers_at_lanes(directions + 2 * count);
    lane_save(field_pdf(&field, splat_uint(cell), vec3_of(x, y, z)), densities + get_global_id(0) * LANES);
}

__kernel void place_in_field(__global const uint* nodes, __global const uint* cells, float4 frame, uint count, __global const float* points,
                             __global const float* normals, __global uint* places) {
    const Field field = {nodes, cells, frame};
    const vec3 p = vec3_of(numbers_at_lanes(points), numbers_at_lanes(points + count), numbers_at_lanes(points + 2 * count));
    const vec3 n = vec3_of(numbers_at_lanes(normals), numbers_at_lanes(normals + count), numbers_at_lanes(normals + 2 * count));
    lane_save(field_place(&field, p, field_face(n), mask_all()), places + get_global_id(0) * LANES);
}
