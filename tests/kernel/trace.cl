// Given rays through a given tree: what the traversals find, and what a loop over every leaf finds.
#include "geometry/traverse.h"

// The plainest way through the tree, for one lane: every child whose box the ray enters before its nearest hit so far, in the order in which
// children are stored. Where to begin reading; tests compare the other traversals with it, to the bit (geometry/box.h says why they agree).
// Trees of instances have a root for each of them; this walks one tree.
#if LANES == 1
// The ray's nearest hit in `nearest` and `primitive`, or with any_hit whether there is one: then `nearest` is negative.
static void bvh_reference(const Bvh* bvh, PacketRay* ray, int any_hit) {
    uint waiting[BVH_STACK];                     // references to visit, and where the ray enters their boxes
    float entered[BVH_STACK];
    int count = 1;
    waiting[0] = bvh->root, entered[0] = 0.0f;
    while (count > 0 && ray->nearest >= 0.0f) {
        const uint reference = waiting[--count];
        const float at = entered[count];
        if (at > ray->nearest) continue;         // a nearer hit was found meanwhile
        if (reference & BVH_LEAF) {
            if (reference & BVH_ANALYTIC) packet_analytic(ray, bvh, reference, at, any_hit);
            else packet_triangles(ray, bvh, reference, at, any_hit);
            continue;
        }
        __global const float* node = bvh->nodes + (size_t)reference * BVH_NODE_WORDS;
        for (uint child = 0; child < 8; ++child) {
            __global const float* low = node + BVH_LOW + child;
            __global const float* high = node + BVH_HIGH + child;
            float near, far;
            box_interval_lanes(low[0] - ray->origin.x, low[8] - ray->origin.y, low[16] - ray->origin.z, high[0] - ray->origin.x,
                               high[8] - ray->origin.y, high[16] - ray->origin.z, ray->inverse.x, ray->inverse.y, ray->inverse.z,
                               packet_begin(ray), &near, &far);
            const uint next = as_uint(node[BVH_CHILD + child]);
            if (next == BVH_EMPTY || !(near <= far) || near > ray->nearest || !packet_reaches(ray, far)) continue;
            waiting[count] = next, entered[count++] = near;
        }
    }
}
#endif

static Ray trace_load(__global const float* rays, __global const uint* ends, uint count, size_t at) {
    Ray ray = ray_make(vec3_of(lane_load(rays + at), lane_load(rays + count + at), lane_load(rays + 2 * (size_t)count + at)),
                       vec3_of(lane_load(rays + 3 * (size_t)count + at), lane_load(rays + 4 * (size_t)count + at),
                               lane_load(rays + 5 * (size_t)count + at)));
    ray.limit = lane_load(rays + 6 * (size_t)count + at);
    ray.from = lane_load(ends + at);
    return ray;
}

static Bvh trace_tree(__global const float* nodes, __global const float* triangle_packs, __global const float* analytic_packs,
                     __global const float* curve_rows) {
    Bvh bvh;
    bvh.nodes = nodes;
    bvh.triangle_packs = triangle_packs;
    bvh.analytic_packs = analytic_packs;
    bvh.root = 0;
#ifdef CURVES
    bvh.curve_rows = curve_rows;
#endif
    return bvh;
}

// rays: float [7][count], origin, direction, limit. ends: uint [2][count], from and to. A ray with a limit below zero is not traced.
// distances: float [count]. hits: uint [2][count], the primitive, and whether anything but `to` is in the way. count: a multiple
// of LANES.
__kernel void trace(__global const float* nodes, __global const float* triangle_packs, __global const float* analytic_packs,
                    __global const float* curve_rows, __global const float* rays, __global const uint* ends, uint count, __global float* distances,
                    __global uint* hits) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const Bvh bvh = trace_tree(nodes, triangle_packs, analytic_packs, curve_rows);
    Ray ray = trace_load(rays, ends, count, at);
    const vmask active = ray.limit >= 0.0f;
    const Hit hit = traverse_nearest(&bvh, &ray, active);
    lane_save(hit.distance, distances + at);
    lane_save(hit.primitive, hits + at);
    ray.to = lane_load(ends + count + at);
    const vmask blocked = traverse_occluded(&bvh, &ray, active);
    lane_save(blocked ? splat_uint(1u) : splat_uint(0u), hits + count + at);
}

// The same by the reference. For LANES = 1.
__kernel void trace_by_reference(__global const float* nodes, __global const float* triangle_packs,
                                 __global const float* analytic_packs, __global const float* curve_rows, __global const float* rays,
                                 __global const uint* ends, uint count, __global float* distances, __global uint* hits) {
#if LANES == 1
    const size_t at = get_global_id(0);
    if (at >= count) return;
    const Bvh bvh = trace_tree(nodes, triangle_packs, analytic_packs, curve_rows);
    Ray ray = trace_load(rays, ends, count, at);
    PacketRay nearest = packet_ray(&ray, ray.limit >= 0.0f);
    bvh_reference(&bvh, &nearest, 0);
    distances[at] = nearest.nearest;
    hits[at] = nearest.primitive;
    ray.to = ends[count + at];
    PacketRay any = packet_ray(&ray, ray.limit >= 0.0f);
    bvh_reference(&bvh, &any, 1);
    hits[count + at] = ray.limit >= 0.0f && any.nearest < 0.0f;
#endif
}

// The definition, without a tree: every primitive of every leaf whose box the ray enters (geometry/box.h). For LANES = 1.
__kernel void trace_every_leaf(__global const float* nodes, __global const float* triangle_packs,
                               __global const float* analytic_packs, __global const float* curve_rows, uint node_count,
                               __global const float* rays, __global const uint* ends, uint count, __global float* distances, __global uint* hits) {
#if LANES == 1
    const size_t at = get_global_id(0);
    if (at >= count) return;
    const Ray ray = trace_load(rays, ends, count, at);
    PacketRay one = packet_ray(&ray, 1);
    const Bvh bvh = trace_tree(nodes, triangle_packs, analytic_packs, curve_rows);
    for (uint number = 0; number < node_count; ++number) {
        __global const float* node = nodes + (size_t)number * BVH_NODE_WORDS;
        for (int i = 0; i < 8; ++i) {
            const uint reference = as_uint(node[BVH_CHILD + i]);
            if (reference == BVH_EMPTY || !(reference & BVH_LEAF)) continue;
            float near, far;
            box_interval_lanes(node[i] - one.origin.x, node[8 + i] - one.origin.y, node[16 + i] - one.origin.z,
                               node[24 + i] - one.origin.x, node[32 + i] - one.origin.y, node[40 + i] - one.origin.z,
                               one.inverse.x, one.inverse.y, one.inverse.z, splat(BOX_START), &near, &far);
            if (!(near <= far)) continue;
            if (reference & BVH_ANALYTIC)
                packet_analytic(&one, &bvh, reference, near, 0);
            else
                packet_triangles(&one, &bvh, reference, near, 0);
        }
    }
    distances[at] = one.nearest;
    hits[at] = one.primitive;
#endif
}
