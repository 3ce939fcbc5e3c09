// The rays of all lanes through the tree together, each box and primitive against all of them, while they agree; a subtree that only
// a few of them want is left to each of those alone, once all else is done and the rays are as short as they get (Benthin, Wald,
// Woop, Ernst, "Combining single and packet-ray tracing for arbitrary ray distributions", 2012).
#ifndef GEOMETRY_BVH_PACKET_H
#define GEOMETRY_BVH_PACKET_H

#include "geometry/packet_leaf.h"
#include "geometry/packet_part.h"
#include "geometry/packet_ray.h"

// Push the children that any lane enters, in the order in which the node has them. Returns the new top of the stack.
static int packet_children(const PacketRay* ray, __global const float* node, uint* stack, vfloat* stack_near, int top) {
    for (int i = 0; i < 8 && as_uint(node[BVH_CHILD + i]) != BVH_EMPTY; ++i) {
        vfloat near, far;
        box_interval_lanes(ray->origin.x - node[i], ray->origin.y - node[8 + i], ray->origin.z - node[16 + i],
                           ray->origin.x - node[24 + i], ray->origin.y - node[32 + i], ray->origin.z - node[40 + i],
                           -ray->inverse.x, -ray->inverse.y, -ray->inverse.z, packet_begin(ray), &near, &far);
        const vmask enters = (near <= far) & (near <= ray->nearest) & packet_reaches(ray, far);
        stack[top + 1] = as_uint(node[BVH_CHILD + i]);
        stack_near[top + 1] = enters ? near : splat(NEVER);
        top += lane_any(enters) ? 1 : 0;
    }
    return top;
}

// Returns how many subtrees are left to the rays alone.
__attribute__((always_inline)) static int bvh_packet(const Bvh* bvh, PacketRay* ray, SingleRays* alone, uint packet, int any_hit) {
    uint stack[BVH_STACK];
    vfloat stack_near[BVH_STACK];
    int top = 0, handed_over = 0;
    stack[0] = bvh->root;
    stack_near[0] = splat(0.0f);
#ifdef INSTANCES
    const vec3 origin = ray->origin, direction = ray->direction;
    int base = 0;                // of the stack's entries those below it are in the world
#endif
    while (top >= 0) {
#ifdef INSTANCES
        if (top < base) {
            packet_leave(ray, origin, direction);
            base = 0;
        }
#endif
        const uint reference = stack[top];
        const vfloat entered = stack_near[top];
        const vmask wants = entered <= ray->nearest;
        --top;
        if (!lane_any(wants)) continue;
        BVH_STEP(ray, reference);
        if (!(reference & BVH_LEAF)) {
#if PACKET_PARTS > 0
            if (lane_count(wants) <= PACKET_PARTS && handed_over < SINGLE_STARTS - 1)
                handed_over += packet_hand_over_within(ray, alone, packet, wants, reference, entered);
            else
#endif
#ifdef INSTANCES
            if (reference & BVH_INSTANCE) {
                packet_enter(bvh, ray, reference & BVH_INDEX, entered);
                stack[++top] = as_uint(bvh->instance_rows[(size_t)ray->instance * INSTANCE_WORDS + bvh->instance_root]);
                stack_near[top] = entered;
                base = top;
            } else
#endif
                top = packet_children(ray, bvh->nodes + (size_t)reference * BVH_NODE_WORDS, stack, stack_near, top);
        } else if (reference & BVH_ANALYTIC)
            packet_analytic(ray, bvh, reference, entered, any_hit);
        else
            packet_triangles(ray, bvh, reference, entered, any_hit);
    }
#ifdef INSTANCES
    packet_leave(ray, origin, direction);
#endif
    return handed_over;
}

#endif
