// The plainest way through the tree, for one lane: every child whose box the ray enters before its nearest hit so far, in the order in which
// children are stored. Where to begin reading; tests compare the other traversals with it, to the bit (geometry/box.h says why they agree).
// Trees of instances have a root for each of them; this walks one tree.
#ifndef GEOMETRY_BVH_REFERENCE_H
#define GEOMETRY_BVH_REFERENCE_H

#include "geometry/bvh_packet.h"

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

#endif
