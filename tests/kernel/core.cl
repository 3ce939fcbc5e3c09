// Operations of core/, one result a lane or a work-item, for tests.
#include "core/frame.h"
#include "core/mis.h"
#include "core/sampler.h"
#include "core/warp.h"

// values: float [count]. tables: float [rows][16]. results: uint [24][count], the same number in all lanes of a work-item where it
// is the work-item's.
__kernel void core_lanes(__global const float* values, __global const float* tables, uint rows, uint count,
                         __global uint* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const vfloat x = lane_load(values + at);
    const vuint row = vuint_from_int(vint_of(absolute(x) * 1000.0f)) % rows;
    const vmask high = x > 0.25f, low = x < -0.25f;
    vuint out[24];
    out[0] = splat_uint(lane_any(high) ? 1u : 0u);
    out[1] = splat_uint((uint)lane_count(high));
    out[2] = splat_uint(as_uint(lane_least(x)));
    out[3] = lane_rank(high);
    out[4] = lane_index();
    out[5] = splat_uint(lane_largest_uint(row));
    out[6] = vfloat_bits(lane_gather(tables, row * 16u + 5u));
    out[7] = (high | low) ? splat_uint(1u) : splat_uint(0u);
    out[8] = (!high & !low) ? splat_uint(1u) : splat_uint(0u);
    out[9] = splat_uint(lane_any(!(high | low)) ? 1u : 0u);
    out[10] = splat_uint((uint)lane_count(!high));
    out[11] = (high != low) ? splat_uint(1u) : splat_uint(0u);
    out[12] = vfloat_bits(lesser(x, splat(0.5f)));
    out[13] = vfloat_bits(greater(x, splat(0.5f)));
    out[14] = splat_uint(lane_any(high & low) ? 1u : 0u);
    vfloat columns[16];
    lane_rows(tables, row, columns);
    // Which column is where, in few outputs: those of other rows have other digits.
    out[15] = vfloat_bits(columns[0]);
    out[16] = vfloat_bits(columns[1]);
    out[17] = vfloat_bits(columns[6]);
    out[18] = vfloat_bits(columns[7]);
    out[19] = vfloat_bits(columns[9]);
    out[20] = vfloat_bits(columns[15]);
    vfloat sum = splat(0.0f);
    for (int k = 0; k < 16; ++k) sum = fma(columns[k], splat((float)(1 << k)), sum);
    out[21] = vfloat_bits(sum);
    float alone[LANES];
    lane_store(x, alone);
    out[22] = vfloat_bits(lane_restore(alone));
    out[23] = vuint_of(vint_of(absolute(x) * 100.0f));
    for (int k = 0; k < 24; ++k) lane_save(out[k], results + (size_t)k * count + at);
}

// values: float [6][count], two vectors a and b. results: float [25][count].
__kernel void core_exact(__global const float* values, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    vfloat in[6];
    for (int k = 0; k < 6; ++k) in[k] = lane_load(values + (size_t)k * count + at);
    const vec3 a = vec3_of(in[0], in[1], in[2]), b = vec3_of(in[3], in[4], in[5]);
    const vec3 cross = outer(a, b), along_a = unit(a), directed = direction_of(a), stepped = along(a, b, in[0]);
    vfloat out[25];
    out[0] = inner(a, b);
    out[1] = difference_of_products(in[0], in[1], in[2], in[3]);
    out[2] = cross.x, out[3] = cross.y, out[4] = cross.z;
    out[5] = along_a.x, out[6] = along_a.y, out[7] = along_a.z;
    out[8] = directed.x, out[9] = directed.y, out[10] = directed.z;
    out[11] = stepped.x, out[12] = stepped.y, out[13] = stepped.z;
    out[14] = root(in[0]);
    out[15] = with_sign(in[0], in[1]);
    out[16] = absolute(in[0]);
    out[17] = bounded(in[0], -0.5f, 0.75f);
    out[18] = magnitude(a);
    out[19] = largest(a);
    const vec3 chosen = choose(in[0] < in[1], a, b);
    out[20] = chosen.x, out[21] = chosen.y, out[22] = chosen.z;
    const vec3 other = sub(mul(add(a, b), scale(a, in[3])), negate(b));
    out[23] = other.x, out[24] = other.z;
    for (int k = 0; k < 25; ++k) lane_save(out[k], results + (size_t)k * count + at);
}

// values: float [count], turns. results: float [2][count].
__kernel void core_cos_sin(__global const float* values, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    vfloat c, s;
    cos_sin_turn(lane_load(values + at), &c, &s);
    lane_save(c, results + at);
    lane_save(s, results + count + at);
}

// values: float [count], above or at 0. results: float [1][count]: e to the power of minus it.
__kernel void core_exp(__global const float* values, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    lane_save(exp_minus(lane_load(values + at)), results + at);
}

// values: uint [count]. results: float [1][count]: minus the logarithm of the number in (0, 1] that these bits stand for.
__kernel void core_minus_log(__global const float* values, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    lane_save(minus_log_of_bits(vfloat_bits(lane_load(values + at))), results + at);
}

// values: float [6][count], a unit normal and any vector. results: float [12][count]: tangent, bitangent, the vector to local and
// back.
__kernel void core_frame(__global const float* values, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    vfloat in[6];
    for (int k = 0; k < 6; ++k) in[k] = lane_load(values + (size_t)k * count + at);
    const Frame f = frame_around(vec3_of(in[0], in[1], in[2]));
    const vec3 inside = frame_to_local(f, vec3_of(in[3], in[4], in[5])), outside = frame_to_world(f, inside);
    const vfloat out[12] = {f.tangent.x, f.tangent.y, f.tangent.z, f.bitangent.x, f.bitangent.y, f.bitangent.z,
                            inside.x, inside.y, inside.z, outside.x, outside.y, outside.z};
    for (int k = 0; k < 12; ++k) lane_save(out[k], results + (size_t)k * count + at);
}

// values: float [5][count], a unit normal and two numbers in [0, 1). results: float [1][count]: cosine of a direction with the normal.
__kernel void core_hemisphere(__global const float* values, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    vfloat in[5];
    for (int k = 0; k < 5; ++k) in[k] = lane_load(values + (size_t)k * count + at);
    const Frame f = frame_around(vec3_of(in[0], in[1], in[2]));
    const vec3 direction = direction_again(frame_to_world(f, warp_cosine_hemisphere(in[3], in[4])));
    lane_save(inner(direction, f.normal), results + at);
}

// values: float [4][count]. results: float [2][count]: what stands for 1/a of the first, and the weight of a sample for all four.
__kernel void core_weights(__global const float* values, uint count, __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    vfloat in[4];
    for (int k = 0; k < 4; ++k) in[k] = lane_load(values + (size_t)k * count + at);
    lane_save(inverse_or_one(in[0]), results + at);
    lane_save(mis_weight(in[0], in[1], in[2], in[3]), results + count + at);
}

// values: uint [3][count]: a sample's number, into how many it is split, and which of these. results: uint [2][count]: seed and number.
__kernel void core_split(__global const float* values, uint count, __global uint* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    uint parts[LANES];
    lane_store(vfloat_bits(lane_load(values + count + at)), parts);
    Sampler sampler;
    sampler.seed = splat_uint(77u);
    sampler.index = vfloat_bits(lane_load(values + at));
    sampler = sampler_split(sampler, parts[0], vfloat_bits(lane_load(values + (size_t)2 * count + at)));
    lane_save(vfloat_from_bits(sampler.seed), (__global float*)results + at);
    lane_save(vfloat_from_bits(sampler.index), (__global float*)results + count + at);
}
