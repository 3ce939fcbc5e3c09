// Nodes and packs that one lane's rays look into on their way to the nearest hit: with the children in order (bvh_one.h), and as they
// lie in the nodes (bvh_packet.h with one lane). For LANES = 1 and with BVH_COUNT_STEPS.
#include "geometry/traverse.h"

// rays: float [7][count], origin, direction, limit. steps: uint [2][count], ordered and not. distances: float [2][count].
__kernel void count_steps(__global const float* nodes, __global const float* triangle_packs, __global const float* analytic_packs,
                          __global const float* rays, uint count, __global uint* steps, __global float* distances) {
    const size_t at = get_global_id(0), n = count;
    if (at >= count) return;
    Bvh bvh;
    bvh.nodes = nodes;
    bvh.triangle_packs = triangle_packs;
    bvh.analytic_packs = analytic_packs;
    bvh.root = 0;
    Ray ray = ray_make(vec3_of(rays[at], rays[n + at], rays[2 * n + at]), vec3_of(rays[3 * n + at], rays[4 * n + at], rays[5 * n + at]));
    ray.limit = rays[6 * n + at];
    PacketRay ordered = packet_ray(&ray, 1), unordered = ordered;
    bvh_one(&bvh, &ordered, 0);
    bvh_packet(&bvh, &unordered, 0, 0, 0);
    steps[at] = ordered.nodes + ordered.packs;
    steps[n + at] = unordered.nodes + unordered.packs;
    distances[at] = ordered.nearest;
    distances[n + at] = unordered.nearest;
}
