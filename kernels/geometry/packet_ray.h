// The rays of all lanes on their way through the tree together: the form that the tests of boxes and primitives want, in the world or within an
// instance, and the nearest hit so far.
#ifndef GEOMETRY_PACKET_RAY_H
#define GEOMETRY_PACKET_RAY_H

#include "geometry/bvh.h"
#include "geometry/motion.h"
#include "geometry/ray.h"
#include "geometry/wide.h"

typedef struct {
    vec3 origin, direction, inverse;
    vfloat slack;                // for the triangle test
    vfloat inverse2;             // one over the direction's square
    vuint from, to;
#ifdef OPACITY
    vfloat after;
    vuint after_primitive;
#endif
    vfloat nearest;
    vuint primitive;
#ifdef INSTANCES
    vfloat start;                // where it enters the instance that it is in; elsewhere BOX_START
    uint instance;               // NONE: none
    uint triangle_offset, analytic_offset;   // from primitives in packs to their numbers
#endif
#ifdef MOTION
    vfloat time;
#endif
#ifdef BVH_COUNT_STEPS
    uint nodes, packs;           // that were looked into
#endif
} PacketRay;

// Counts what a traversal costs wherever it runs (tests/kernel/test_steps.py, scripts/ray_bench.py).
#ifdef BVH_COUNT_STEPS
#define BVH_STEP(ray, reference) (reference) & BVH_LEAF ? ++(ray)->packs : ++(ray)->nodes
#else
#define BVH_STEP(ray, reference)
#endif

static void packet_aim(PacketRay* p, vec3 origin, vec3 direction) {
    p->origin = origin;
    p->direction = direction;
    p->inverse = vec3_of(ray_inverse_lanes(direction.x), ray_inverse_lanes(direction.y), ray_inverse_lanes(direction.z));
    p->inverse2 = ray_inverse2_lanes(direction.x, direction.y, direction.z);
    p->slack = ray_slack_lanes(direction.x, direction.y, direction.z);
}

static PacketRay packet_ray(const Ray* ray, vmask active) {
    PacketRay p;
    packet_aim(&p, ray->origin, ray->direction);
    p.from = ray->from;
    p.to = ray->to;
#ifdef OPACITY
    p.after = ray->after;
    p.after_primitive = ray->after_primitive;
#endif
    p.nearest = active ? ray->limit : splat(-1.0f);
    p.primitive = splat_uint(NONE);
#ifdef INSTANCES
    p.start = splat(BOX_START);
    p.instance = NONE;
    p.triangle_offset = p.analytic_offset = 0;
#endif
#ifdef MOTION
    p.time = ray->time;
#endif
#ifdef BVH_COUNT_STEPS
    p.nodes = p.packs = 0;
#endif
    return p;
}

#ifdef INSTANCES
static vfloat packet_begin(const PacketRay* ray) { return ray->start; }
static uint packet_triangle_offset(const PacketRay* ray) { return ray->triangle_offset; }
static uint packet_analytic_offset(const PacketRay* ray, uint kind) {
    return kind - ANALYTIC_RECTANGLE < 3u ? ray->triangle_offset : ray->analytic_offset;
}
#else
static vfloat packet_begin(const PacketRay* ray) { return splat(BOX_START); }
static uint packet_triangle_offset(const PacketRay* ray) { return 0; }
static uint packet_analytic_offset(const PacketRay* ray, uint kind) { return 0; }
#endif

#ifdef OPACITY
static vfloat packet_after(const PacketRay* ray) { return ray->after; }
static vmask packet_reaches(const PacketRay* ray, vfloat far) { return far >= ray->after; }
#else
static vfloat packet_after(const PacketRay* ray) { return splat(0.0f); }
static vmask packet_reaches(const PacketRay* ray, vfloat far) { return mask_all(); }
#endif

// Whether a hit of this primitive is behind what is left out.
static vmask packet_counts(const PacketRay* ray, vfloat at, vuint id) {
#ifdef OPACITY
    return (at > ray->after) | ((at == ray->after) & (id > ray->after_primitive));
#else
    return at > BOX_START;
#endif
}

#ifdef INSTANCES
// A packet goes on in an instance. Those of its rays that do not enter have `entered` NEVER, which keeps them out.
static void packet_enter(const Bvh* bvh, PacketRay* ray, uint instance, vfloat entered) {
    __global const float* row = bvh->instance_rows + (size_t)instance * INSTANCE_WORDS;
    vec3 o = ray->origin, d = ray->direction;
#ifdef MOTION
    __global const uint* motion = bvh->instance_motions + INSTANCE_MOTION_WORDS * (size_t)instance;
    const uint segments = motion[1];
    if (segments > 0u) {
        MotionMap map;
        motion_at(bvh->motion_rows, splat_uint(motion[0]), splat_uint(segments), ray->time, &map);
        o = motion_point_back(&map, o);
        d = motion_turned(map.inverse, d);
    }
#endif
    float m[12];
    for (int k = 0; k < 12; ++k) m[k] = row[INSTANCE_ROW_TO_OBJECT + k];
    vfloat origin[3], direction[3];
    for (int k = 0; k < 3; ++k) {
        const vfloat m_x = splat(m[k * 4]), m_y = splat(m[k * 4 + 1]), m_z = splat(m[k * 4 + 2]);
        origin[k] = ray_carried_lanes(m_x, m_y, m_z, splat(m[k * 4 + 3]), o.x, o.y, o.z);
        direction[k] = ray_carried_lanes(m_x, m_y, m_z, splat(0.0f), d.x, d.y, d.z);
    }
    packet_aim(ray, vec3_row(origin, 0), vec3_row(direction, 0));
    ray->start = entered;
    ray->instance = instance;
    ray->triangle_offset = as_uint(row[INSTANCE_ROW_TRIANGLE_OFFSET]);
    ray->analytic_offset = as_uint(row[INSTANCE_ROW_ANALYTIC_OFFSET]);
}

// And back in the world.
static void packet_leave(PacketRay* ray, vec3 origin, vec3 direction) {
    packet_aim(ray, origin, direction);
    ray->start = splat(BOX_START);
    ray->instance = NONE;
    ray->triangle_offset = ray->analytic_offset = 0;
}
#endif

#endif
