// What the integrators ask of the scene: the nearest hit of each lane's ray, and whether anything stands in its way.
//
// The answers do not depend on how they are found: the lanes' rays go through the tree together, or with TRAVERSAL_SINGLE each goes
// alone. They are the same to the bit (geometry/box.h says why).
#ifndef GEOMETRY_TRAVERSE_H
#define GEOMETRY_TRAVERSE_H

#include "geometry/bvh_one.h"
#include "geometry/bvh_packet.h"
#include "geometry/bvh_single.h"
#include "geometry/ray.h"

#if (LANES > 1 && PACKET_PARTS > 0) || defined(TRAVERSAL_SINGLE)
#define TRAVERSE_ALONE 1
#else
#define TRAVERSE_ALONE 0
#endif

// Rays of several packets on their way through the tree. Each packet sets out and goes as far as its rays agree; what is left to rays
// alone waits for all packets, so that many take turns. It is asked either for the nearest hits or for any.
typedef struct {
    vfloat nearest[PACKETS];
    vuint primitive[PACKETS];
#if TRAVERSE_ALONE
    int parted[PACKETS];
    SingleRays alone;
#endif
} Traversal;

// A packet sets out; every one of them has to before they finish.
__attribute__((always_inline)) static void traverse_start(const Bvh* bvh, Traversal* t, uint packet, const Ray* ray, vmask active, int any_hit) {
    PacketRay together = packet_ray(ray, active);
#if TRAVERSE_ALONE
    lane_store((vint)(-1), t->alone.top + packet * LANES);
#ifdef TRAVERSAL_SINGLE
    packet_hand_over(&t->alone, packet, together.nearest >= 0.0f, bvh->root, splat(0.0f));
    t->parted[packet] = 1;
#else
    t->parted[packet] = bvh_packet(bvh, &together, &t->alone, packet, any_hit);
#endif
    if (t->parted[packet]) packet_part(&together, &t->alone, packet);
#elif LANES == 1
    bvh_one(bvh, &together, any_hit);
#else
    bvh_packet(bvh, &together, 0, packet, any_hit);
#endif
    t->nearest[packet] = together.nearest;
    t->primitive[packet] = together.primitive;
}

// The rays alone go on to their ends.
__attribute__((always_inline)) static void traverse_finish(const Bvh* bvh, Traversal* t, int any_hit) {
#if TRAVERSE_ALONE
    bvh_single(bvh, &t->alone, any_hit);
    EACH_PACKET(k) {
        if (!t->parted[k]) continue;
        t->nearest[k] = lane_restore(t->alone.nearest + k * LANES);
        t->primitive[k] = lane_restore(t->alone.primitive + k * LANES);
    }
#endif
}

static Hit traverse_hit(const Traversal* t, uint packet) {
    Hit hit;
    hit.distance = t->nearest[packet];
    hit.primitive = t->primitive[packet];
    return hit;
}

static vmask traverse_blocked(const Traversal* t, uint packet) { return t->nearest[packet] < 0.0f; }

// The other packets have no rays on their way.
static void traverse_no_others(Traversal* t) {
#if TRAVERSE_ALONE
    for (uint k = 1; k < PACKETS; ++k) {
        lane_store((vint)(-1), t->alone.top + k * LANES);
        t->parted[k] = 0;
    }
#endif
}

// One packet on its own.
static Hit traverse_nearest(const Bvh* bvh, const Ray* ray, vmask active) {
    Traversal t;
    traverse_no_others(&t);
    traverse_start(bvh, &t, 0, ray, active, 0);
    traverse_finish(bvh, &t, 0);
    return traverse_hit(&t, 0);
}

static vmask traverse_occluded(const Bvh* bvh, const Ray* ray, vmask active) {
    Traversal t;
    traverse_no_others(&t);
    traverse_start(bvh, &t, 0, ray, active, 1);
    traverse_finish(bvh, &t, 1);
    return active & traverse_blocked(&t, 0);
}

#endif
