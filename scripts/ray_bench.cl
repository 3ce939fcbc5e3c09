// Given rays through a scene's tree, as the path tracer sends them: PACKETS packets of LANES rays for each work-item (scripts/ray_bench.py).
#include "geometry/traverse.h"

// rays: float [7][count], origin, direction, limit; from: primitives that they leave. count: a multiple of what a work-item takes.
static Ray bench_ray(__global const float* rays, __global const uint* from, uint count, size_t at) {
    const size_t step = count;
    Ray ray = ray_make(vec3_of(lane_load(rays + at), lane_load(rays + step + at), lane_load(rays + 2 * step + at)),
                       vec3_of(lane_load(rays + 3 * step + at), lane_load(rays + 4 * step + at), lane_load(rays + 5 * step + at)));
    ray.limit = lane_load(rays + 6 * step + at);
    ray.from = lane_load(from + at);
    return ray;
}

static Bvh bench_tree(__global const float* nodes, __global const float* triangle_packs, __global const float* analytic_packs) {
    Bvh bvh;
    bvh.nodes = nodes;
    bvh.triangle_packs = triangle_packs;
    bvh.analytic_packs = analytic_packs;
    bvh.root = 0;
    return bvh;
}

static void bench_trace(__global const float* nodes, __global const float* triangle_packs, __global const float* analytic_packs,
                        __global const float* rays, __global const uint* from, uint count, __global float* distances, __global uint* hits,
                        int any_hit) {
    const size_t first = (size_t)get_global_id(0) * (LANES * PACKETS);
    if (first >= count) return;
    const Bvh bvh = bench_tree(nodes, triangle_packs, analytic_packs);
    Traversal traversal;
    EACH_PACKET(k) {
        const Ray ray = bench_ray(rays, from, count, first + k * LANES);
        traverse_start(&bvh, &traversal, k, &ray, ray.limit >= 0.0f, any_hit);
    }
    traverse_finish(&bvh, &traversal, any_hit);
    EACH_PACKET(k) {
        lane_save(traversal.nearest[k], distances + first + k * LANES);
        lane_save(traversal.primitive[k], hits + first + k * LANES);
    }
}

// distances: to the nearest hit. hits: its primitive, or NONE.
__kernel void bench_nearest(__global const float* nodes, __global const float* triangle_packs, __global const float* analytic_packs,
                            __global const float* rays, __global const uint* from, uint count, __global float* distances,
                            __global uint* hits) {
    bench_trace(nodes, triangle_packs, analytic_packs, rays, from, count, distances, hits, 0);
}

// distances: below zero where anything is in the way.
__kernel void bench_any(__global const float* nodes, __global const float* triangle_packs, __global const float* analytic_packs,
                        __global const float* rays, __global const uint* from, uint count, __global float* distances,
                        __global uint* hits) {
    bench_trace(nodes, triangle_packs, analytic_packs, rays, from, count, distances, hits, 1);
}

// steps: uint [2][count], of each ray alone the nodes and the packs that it looks into. For LANES = 1.
#ifdef BVH_COUNT_STEPS
static void bench_count(__global const float* nodes, __global const float* triangle_packs, __global const float* analytic_packs,
                        __global const float* rays, __global const uint* from, uint count, __global uint* steps, int any_hit) {
    const size_t at = get_global_id(0);
    if (at >= count) return;
    const Bvh bvh = bench_tree(nodes, triangle_packs, analytic_packs);
    const Ray ray = bench_ray(rays, from, count, at);
    PacketRay alone = packet_ray(&ray, ray.limit >= 0.0f);
    bvh_one(&bvh, &alone, any_hit);
    steps[at] = alone.nodes;
    steps[count + at] = alone.packs;
}
__kernel void bench_count_nearest(__global const float* nodes, __global const float* triangle_packs,
                                  __global const float* analytic_packs, __global const float* rays, __global const uint* from, uint count,
                                  __global uint* steps) {
    bench_count(nodes, triangle_packs, analytic_packs, rays, from, count, steps, 0);
}
__kernel void bench_count_any(__global const float* nodes, __global const float* triangle_packs, __global const float* analytic_packs,
                              __global const float* rays, __global const uint* from, uint count, __global uint* steps) {
    bench_count(nodes, triangle_packs, analytic_packs, rays, from, count, steps, 1);
}
#endif
