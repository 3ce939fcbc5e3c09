// One lane's ray through the tree: what a GPU runs, where neighbouring work-items are lanes already.
//
// The children that the ray enters are visited in the order in which it enters them. The stack keeps an entry for each level of the tree,
// not for each child: a node, and which of its children are still to be visited, four bits each, as in Ylitie, Karras and Laine,
// "Efficient incoherent ray traversal on GPUs through compressed wide BVHs" (2017). That is a seventh of the entries, in memory that each of
// some hundred thousand rays has of its own. Where the ray enters a child is computed once more when its turn comes, from six numbers
// that are in the cache.
//
// Hits are those of the other traversals, to the bit (geometry/box.h).
#ifndef GEOMETRY_BVH_ONE_H
#define GEOMETRY_BVH_ONE_H

#include "geometry/bvh_packet.h"

#if LANES == 1

// A level of the tree takes seven entries of the stacks that keep every child.
#define ONE_LEVELS ((BVH_STACK + 6) / 7)
// A child among those that are still to be visited: its number and this, which tells it from none.
#define ONE_CHILD 8u
#define ONE_CHILD_BITS 4u

// Sorts after every distance: of a child that the ray does not enter.
#define ONE_LAST 0xffffffffu

#define ONE_ORDER(a, b) { const uint less = min(a, b), more = max(a, b); a = less, b = more; }

// Eight children in the order of their keys, packed, the first in the lowest bits: a network of 19 exchanges (Knuth, The Art of Computer
// Programming 3, 5.3.4). Keys hold the child's number in their last three bits.
static uint one_sorted(const uint key[8]) {
    uint a = key[0], b = key[1], c = key[2], d = key[3], e = key[4], f = key[5], g = key[6], h = key[7];
    ONE_ORDER(a, c) ONE_ORDER(b, d) ONE_ORDER(e, g) ONE_ORDER(f, h)
    ONE_ORDER(a, e) ONE_ORDER(b, f) ONE_ORDER(c, g) ONE_ORDER(d, h)
    ONE_ORDER(a, b) ONE_ORDER(c, d) ONE_ORDER(e, f) ONE_ORDER(g, h)
    ONE_ORDER(c, e) ONE_ORDER(d, f)
    ONE_ORDER(b, e) ONE_ORDER(d, g)
    ONE_ORDER(b, c) ONE_ORDER(d, e) ONE_ORDER(f, g)
    const uint8 sorted = (uint8)(a, b, c, d, e, f, g, h);
    const uint8 child = (sorted == ONE_LAST ? (uint8)(0u) : ((sorted & 7u) | ONE_CHILD)) << (uint8)(0, 4, 8, 12, 16, 20, 24, 28);
    const uint4 half_ = child.lo | child.hi;
    const uint2 pair = half_.lo | half_.hi;
    return pair.x | pair.y;
}

// Where a node has, along one axis, the planes of boxes that the ray meets first, and those that it meets last. That gives the same interval
// as sorting them does, since rounding is monotonic, and none in the inverted boxes of children that are not there.
#define ONE_NEAR(axis, number) ((ray->inverse.axis < 0.0f ? BVH_HIGH : BVH_LOW) + 8 * number)
#define ONE_FAR(axis, number) ((ray->inverse.axis < 0.0f ? BVH_LOW : BVH_HIGH) + 8 * number)
// Where the ray meets a plane.
#define ONE_AT(axis, plane) ((ray->origin.axis - (plane)) * -ray->inverse.axis)

// Four planes of a node, in a load of 16 bytes: vload4 promises an alignment of four bytes only, which is four loads on some GPUs.
static float4 one_planes(__global const float* node, int first) { return *(__global const float4*)(node + first); }

// The children of a node that the ray enters, the nearest first. Four at a time: the planes of eight would take 48 registers.
static uint one_children(const PacketRay* ray, __global const float* node) {
    uint key[8];
    #pragma unroll
    for (uint first = 0; first < 8; first += 4) {
        const float4 near_x = one_planes(node, ONE_NEAR(x, 0) + first), far_x = one_planes(node, ONE_FAR(x, 0) + first);
        const float4 near_y = one_planes(node, ONE_NEAR(y, 1) + first), far_y = one_planes(node, ONE_FAR(y, 1) + first);
        const float4 near_z = one_planes(node, ONE_NEAR(z, 2) + first), far_z = one_planes(node, ONE_FAR(z, 2) + first);
        const float planes[6][4] = {{near_x.x, near_x.y, near_x.z, near_x.w}, {near_y.x, near_y.y, near_y.z, near_y.w},
                                    {near_z.x, near_z.y, near_z.z, near_z.w}, {far_x.x, far_x.y, far_x.z, far_x.w},
                                    {far_y.x, far_y.y, far_y.z, far_y.w},     {far_z.x, far_z.y, far_z.z, far_z.w}};
        #pragma unroll
        for (uint child = 0; child < 4; ++child) {
            float near, far;
            box_clip_lanes(ONE_AT(x, planes[0][child]), ONE_AT(y, planes[1][child]), ONE_AT(z, planes[2][child]), ONE_AT(x, planes[3][child]),
                           ONE_AT(y, planes[4][child]), ONE_AT(z, planes[5][child]), packet_begin(ray), &near, &far);
            const int enters = (near <= far) & (near <= ray->nearest) & packet_reaches(ray, far);
            // Distances count but for their last three bits, which are the child's number
            key[first + child] = enters ? (as_uint(near) & ~7u) | (first + child) : ONE_LAST;
        }
    }
    return one_sorted(key);
}

// Where the ray enters a child of which it is known that it does.
static float one_entered(const PacketRay* ray, __global const float* node, uint child) {
    const float x = ONE_AT(x, node[ONE_NEAR(x, 0) + child]), y = ONE_AT(y, node[ONE_NEAR(y, 1) + child]);
    const float z = ONE_AT(z, node[ONE_NEAR(z, 2) + child]);
    float near, far;
    box_clip_lanes(x, y, z, x, y, z, packet_begin(ray), &near, &far);
    return near;
}

// The ray's nearest hit, or with any_hit whether there is one.
__attribute__((always_inline)) static void bvh_one(const Bvh* bvh, PacketRay* ray, int any_hit) {
    volatile uint nodes[ONE_LEVELS], waiting[ONE_LEVELS];     // of waiting children the next in the lowest bits
    int level = 0;
    uint reference = bvh->root;
    float entered = 0.0f;
#ifdef INSTANCES
    const vec3 origin = ray->origin, direction = ray->direction;
    int base = 0;                                    // levels of the stack that are in the world
#endif
    for (;;) {
        uint children = 0, parent = reference;
        if (entered <= ray->nearest) {
            BVH_STEP(ray, reference);
            if (reference & BVH_LEAF) {
                if (reference & BVH_ANALYTIC)
                    packet_analytic(ray, bvh, reference, entered, any_hit);
                else
                    packet_triangles(ray, bvh, reference, entered, any_hit);
                if (any_hit && ray->nearest < 0.0f) break;
#ifdef INSTANCES
            } else if (reference & BVH_INSTANCE) {
                packet_enter(bvh, ray, reference & BVH_INDEX, entered);
                reference = as_uint(bvh->instance_rows[(size_t)ray->instance * INSTANCE_WORDS + bvh->instance_root]);
                base = level;
                continue;
#endif
            } else
                children = one_children(ray, bvh->nodes + (size_t)reference * BVH_NODE_WORDS);
        }
        if (!children) {
            if (!level) break;
#ifdef INSTANCES
            if (ray->instance != NONE && level == base) packet_leave(ray, origin, direction);
#endif
            --level;
            parent = nodes[level];
            children = waiting[level];
        }
        __global const float* node = bvh->nodes + (size_t)parent * BVH_NODE_WORDS;
        const uint child = children & (ONE_CHILD - 1u);
        nodes[level] = parent;
        waiting[level] = children >> ONE_CHILD_BITS;
        level += waiting[level] ? 1 : 0;
        reference = as_uint(node[BVH_CHILD + child]);
        entered = one_entered(ray, node, child);
    }
}

#endif

#endif
