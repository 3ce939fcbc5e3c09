// What the integrators ask of the scene: the nearest hit of each lane's ray, and whether anything stands in its way.
//
// The answers do not depend on how they are found: the lanes' rays go through the tree together, or with TRAVERSAL_SINGLE each goes
// alone. They are the same to the bit (geometry/box.h says why).
#ifndef GEOMETRY_TRAVERSE_H
#define GEOMETRY_TRAVERSE_H

#include "geometry/bvh_packet.h"
#include "geometry/bvh_single.h"
#include "geometry/ray.h"

__attribute__((always_inline)) static void traverse(const Bvh* bvh, PacketRay* ray, int any_hit) {
#ifndef TRAVERSAL_SINGLE
    bvh_packet(bvh, ray, any_hit);
#else
    SingleRays alone;
    packet_none_alone(&alone);
    packet_hand_over(&alone, ray->nearest >= 0.0f, bvh->root, splat(0.0f));
    packet_alone(bvh, ray, &alone, any_hit);
#endif
}

static Hit traverse_nearest(const Bvh* bvh, const Ray* ray, vmask active) {
    PacketRay packet = packet_ray(ray, active);
    traverse(bvh, &packet, 0);
    Hit hit;
    hit.distance = packet.nearest;
    hit.primitive = packet.primitive;
    return hit;
}

static vmask traverse_occluded(const Bvh* bvh, const Ray* ray, vmask active) {
    PacketRay packet = packet_ray(ray, active);
    traverse(bvh, &packet, 1);
    return active & (packet.nearest < 0.0f);
}

#endif
