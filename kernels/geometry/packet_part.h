// Where rays part: a subtree that only a few lanes want is handed to each of their rays alone (bvh_single.h), for later.
#ifndef GEOMETRY_PACKET_PART_H
#define GEOMETRY_PACKET_PART_H

#include "geometry/bvh_single.h"
#include "geometry/packet_ray.h"

// With so few lanes left, they part: sooner where several packets' rays take turns, which spares each of them waiting, but not where
// paths are sorted by their materials (measured: docs/notes/materials.md); and among leaves with holes sooner still. 0: never, as on a GPU, where one lane walks the tree and
// nothing is left to part.
#ifndef PACKET_PARTS
#if defined(OPACITY)
#define PACKET_PARTS (LANES * 3 / 4)
#elif PACKETS > 1 && !defined(MATERIALS) && !defined(TEXTURES)
#define PACKET_PARTS (LANES / 2)
#else
#define PACKET_PARTS (LANES / 4)
#endif
#endif

// Hand a subtree to the lanes that want it.
static void packet_hand_over(SingleRays* rays, uint packet, vmask wants, uint reference, vfloat entered) {
    int wanted[LANES];
    float enters[LANES];
    lane_store(wants, wanted);
    lane_store(entered, enters);
    const uint first = packet * LANES;
    for (int lane = 0; lane < LANES; ++lane) {
        rays->stack[first + lane][rays->top[first + lane] + 1] = single_entry(reference, enters[lane]);
        rays->top[first + lane] += wanted[lane] ? 1 : 0;
    }
}

#ifdef INSTANCES
// Hand over a subtree of the instance that the packet is in. Returns how many entries that takes.
static int packet_hand_over_within(const PacketRay* ray, SingleRays* rays, uint packet, vmask wants, uint reference, vfloat entered) {
    packet_hand_over(rays, packet, wants, reference, entered);
    if (ray->instance == NONE) return 1;
    packet_hand_over(rays, packet, wants, ray->instance | BVH_INSTANCE | SINGLE_WITHIN, ray->start);
    return 2;
}
#else
static int packet_hand_over_within(const PacketRay* ray, SingleRays* rays, uint packet, vmask wants, uint reference, vfloat entered) {
    packet_hand_over(rays, packet, wants, reference, entered);
    return 1;
}
#endif

// Along one axis, what a packet's rays alone start with.
static void packet_part_axis(SingleRays* rays, uint first, uint axis, vfloat origin, vfloat direction, vfloat inverse) {
    const vuint low = splat_uint(BVH_LOW + 8 * axis), high = splat_uint(BVH_HIGH + 8 * axis);
    const vmask down = inverse < 0.0f;
    lane_store(origin, rays->origin[axis] + first);
    lane_store(direction, rays->direction[axis] + first);
    lane_store((-inverse), rays->minus_inverse[axis] + first);
    lane_store((down ? high : low), rays->near_plane[axis] + first);
    lane_store((down ? low : high), rays->far_plane[axis] + first);
}

// The packet's rays as each of them goes on alone, through what is handed to it.
static void packet_part(const PacketRay* ray, SingleRays* rays, uint packet) {
    const uint first = packet * LANES;
    packet_part_axis(rays, first, 0, ray->origin.x, ray->direction.x, ray->inverse.x);
    packet_part_axis(rays, first, 1, ray->origin.y, ray->direction.y, ray->inverse.y);
    packet_part_axis(rays, first, 2, ray->origin.z, ray->direction.z, ray->inverse.z);
    lane_store(ray->slack, rays->slack + first);
    lane_store(ray->inverse2, rays->inverse2 + first);
    lane_store(ray->from, rays->from + first);
    lane_store(ray->to, rays->to + first);
#ifdef OPACITY
    lane_store(ray->after, rays->after + first);
    lane_store(ray->after_primitive, rays->after_primitive + first);
#endif
    lane_store(ray->nearest, rays->nearest + first);
    lane_store(ray->primitive, rays->primitive + first);
#ifdef INSTANCES
    const vfloat world[6] = {ray->origin.x, ray->origin.y, ray->origin.z, ray->direction.x, ray->direction.y, ray->direction.z};
    for (uint k = 0; k < 6; ++k) lane_store(world[k], rays->world[k] + first);
#ifdef MOTION
    lane_store(ray->time, rays->time + first);
#endif
    lane_store(splat(BOX_START), rays->start + first);
    for (uint lane = first; lane < first + LANES; ++lane) rays->base[lane] = 0, rays->triangle_offset[lane] = rays->analytic_offset[lane] = 0;
#ifdef DEFORMATION
    for (uint lane = first; lane < first + LANES; ++lane) rays->instance[lane] = NONE;
#endif
#endif
}

#endif
