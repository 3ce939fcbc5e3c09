// First steps of the tree: what stands in it as one, its boxes, and its order by Morton codes. Deterministic: the sort is stable and
// every sum is of integers.
#include "geometry/build.h"

// Whether triangle i and the next are the halves A B C and A C D of a parallelogram, to within the rounding of its corners, which is
// tested at the price of one triangle. Of a slender one, the rounding counts by how slender it is, since its ends are found by the long
// sides; but not where it is square to an axis, which is tested in another way. Only every second triangle of a shape is asked, so that
// none is in two pairs.
static int build_is_pair(__global const float* vertices, __global const uint* triangles, __global const uint* primitive_shape,
                         __global const Shape* shapes, uint triangle_count, uint i) {
    if (i + 1 >= triangle_count || primitive_shape[i] != primitive_shape[i + 1]) return 0;
    if ((i - shapes[primitive_shape[i]].first_primitive) % 2u) return 0;
    vec3 corner[6];
    for (uint k = 0; k < 6; ++k) corner[k] = build_vertex(vertices, triangles, (size_t)i * 3 + k);
    const vec3 a = corner[0], b = corner[1], c = corner[2], d = corner[5];
    const vec3 other = sub(a, corner[3]), again = sub(c, corner[4]);
    if (largest_size(other) != 0.0f || largest_size(again) != 0.0f) return 0;
    const float coordinate = greater(greater(largest_size(a), largest_size(b)), greater(largest_size(c), largest_size(d)));
    const vec3 normal = outer(sub(b, a), sub(d, a));
    if (!(largest_size(normal) > 0.0f)) return 0;
    const float size_ab = largest_size(sub(b, a)), size_ad = largest_size(sub(d, a)), size = greater(size_ab, size_ad);
    const float slender = lesser(size_ab, size_ad) * inverse_scale(vec3_of(size, size, size)) * 16.0f;
    const float allowed = slender < 1.0f && build_rectangle_axis(a, b, c, d) == 3 ? slender : 1.0f;
    return parallelogram_gap(a, b, c, d) <= coordinate * (8.0f * EPSILON) * allowed;
}

// A triangle, or with what follows it a pair, as a unit.
static uint build_unit(__global const float* vertices, __global const uint* triangles, __global const uint* primitive_shape,
                       __global const Shape* shapes, uint triangle_count, uint i) {
    if (!build_is_pair(vertices, triangles, primitive_shape, shapes, triangle_count, i)) return i;
    vec3 corner[6];
    for (uint k = 0; k < 6; ++k) corner[k] = build_vertex(vertices, triangles, (size_t)i * 3 + k);
    return i | BVH_PAIR | (build_rectangle_axis(corner[0], corner[1], corner[2], corner[5]) < 3 ? BVH_RECTANGLE : 0u);
}

// For each triangle whether something begins with it: not with the second of a pair.
__kernel void build_starts(__global const float* vertices, __global const uint* triangles, __global const uint* primitive_shape,
                           __global const Shape* shapes, uint triangle_count, __global uint* starts) {
    const uint i = (uint)get_global_id(0);
    if (i >= triangle_count) return;
    starts[i] = i > 0 && build_is_pair(vertices, triangles, primitive_shape, shapes, triangle_count, i - 1) ? 0u : 1u;
}

// The triangles and pairs, by the sums of the above.
__kernel void build_units(__global const float* vertices, __global const uint* triangles, __global const uint* primitive_shape,
                          __global const Shape* shapes, uint triangle_count, __global const uint* places, __global uint* units) {
    const uint i = (uint)get_global_id(0);
    if (i >= triangle_count) return;
    if (i > 0 && build_is_pair(vertices, triangles, primitive_shape, shapes, triangle_count, i - 1)) return;
    units[places[i]] = build_unit(vertices, triangles, primitive_shape, shapes, triangle_count, i);
}

// Of units of a tree, what each would be now.
__kernel void refit_units(__global const float* vertices, __global const uint* triangles, __global const uint* primitive_shape,
                          __global const Shape* shapes, uint triangle_count, __global const uint* units, uint count, __global uint* now) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    now[i] = build_unit(vertices, triangles, primitive_shape, shapes, triangle_count, units[i] & ~(BVH_PAIR | BVH_RECTANGLE));
}

// Boxes of units. Boxes of instances are given as they are.
__kernel void build_boxes(__global const uint* units, __global const float* vertices, __global const uint* triangles,
                          __global const AnalyticShape* analytic_shapes, __global const uint* round_ones, __global const float* instance_boxes,
                          uint triangle_units, uint round_count, uint count, __global float* boxes) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    if (i >= triangle_units + round_count) {
        box_save(boxes, i, box_load(instance_boxes, i - triangle_units - round_count));
        return;
    }
    box_save(boxes, i, i < triangle_units ? box_of_triangles(units[i] & ~BVH_RECTANGLE, vertices, triangles)
                                          : box_of_round(analytic_shapes[round_ones[i - triangle_units]]));
}

// Bounds of the boxes' centres (times two), chunk by chunk; run again on its own result until one box is left.
__kernel void build_bounds(__global const float* boxes, uint count, uint centers, __global float* bounds) {
    const uint chunk = (uint)get_global_id(0);
    const uint first = chunk * BUILD_CHUNK, last = min(count, first + BUILD_CHUNK);
    if (first >= count) return;
    Box b = box_empty();
    for (uint i = first; i < last; ++i) {
        Box one = box_load(boxes, i);
        if (centers)
            for (int k = 0; k < 3; ++k) one.low[k] = one.high[k] = one.low[k] * 0.5f + one.high[k] * 0.5f;
        b = box_union(b, one);
    }
    box_save(bounds, chunk, b);
}

// Spread the low 21 bits of x, two zeros after each.
static ulong build_spread(uint value) {
    ulong x = value & 0x1fffffu;
    x = (x | x << 32) & 0x001f00000000fffful;
    x = (x | x << 16) & 0x001f0000ff0000fful;
    x = (x | x << 8) & 0x100f00f00f00f00ful;
    x = (x | x << 4) & 0x10c30c30c30c30c3ul;
    return (x | x << 2) & 0x1249249249249249ul;
}

__kernel void build_morton(__global const float* boxes, __global const float* bounds, uint count, __global ulong* keys,
                           __global uint* values) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    const Box all = box_load(bounds, 0), b = box_load(boxes, i);
    ulong key = 0;
    for (int k = 0; k < 3; ++k) {
        const float size = all.high[k] - all.low[k];
        const float center = b.low[k] * 0.5f + b.high[k] * 0.5f;
        const float at = size > 0.0f ? quotient(center - all.low[k], size) : 0.0f;
        key |= build_spread((uint)(lesser(greater(at, 0.0f), 1.0f) * 2097151.0f)) << k;
    }
    keys[i] = key;
    values[i] = i;
}

// Radix sort, eight bits a pass: how often each digit occurs in each chunk, …
__kernel void build_sort_count(__global const ulong* keys, uint count, uint shift, uint chunks, __global uint* counts) {
    const uint chunk = (uint)get_global_id(0);
    if (chunk >= chunks) return;
    uint seen[256];
    for (int digit = 0; digit < 256; ++digit) seen[digit] = 0;
    const uint first = chunk * BUILD_CHUNK, last = min(count, first + BUILD_CHUNK);
    for (uint i = first; i < last; ++i) seen[(uint)(keys[i] >> shift) & 255u]++;
    for (uint digit = 0; digit < 256; ++digit) counts[(size_t)digit * chunks + chunk] = seen[digit];
}

// … and, once these are summed up, where each element goes.
__kernel void build_sort_scatter(__global const ulong* keys, __global const uint* values, uint count, uint shift, uint chunks,
                                 __global const uint* offsets, __global ulong* sorted_keys, __global uint* sorted_values) {
    const uint chunk = (uint)get_global_id(0);
    if (chunk >= chunks) return;
    uint next[256];
    for (uint digit = 0; digit < 256; ++digit) next[digit] = offsets[(size_t)digit * chunks + chunk];
    const uint first = chunk * BUILD_CHUNK, last = min(count, first + BUILD_CHUNK);
    for (uint i = first; i < last; ++i) {
        const uint to = next[(uint)(keys[i] >> shift) & 255u]++;
        sorted_keys[to] = keys[i];
        sorted_values[to] = values[i];
    }
}

// Exclusive prefix sums in place, chunk by chunk; `sums` gets each chunk's total.
__kernel void build_scan(__global uint* numbers, uint count, __global uint* sums) {
    const uint chunk = (uint)get_global_id(0);
    const uint first = chunk * BUILD_CHUNK, last = min(count, first + BUILD_CHUNK);
    if (first >= count) return;
    uint sum = 0;
    for (uint i = first; i < last; ++i) {
        const uint number = numbers[i];
        numbers[i] = sum;
        sum += number;
    }
    sums[chunk] = sum;
}
__kernel void build_scan_add(__global uint* numbers, uint count, __global const uint* sums) {
    const uint i = (uint)get_global_id(0);
    if (i < count) numbers[i] += sums[i / BUILD_CHUNK];
}
