// A ray, and how one leaves a surface.
#ifndef GEOMETRY_RAY_H
#define GEOMETRY_RAY_H

#include "core/exact.h"
#include "core/invariant.h"
#include "geometry/box.h"
#include "types.h"

typedef struct {
    vec3 origin;
    vec3 direction;      // of any length; distances along the ray are multiples of it
    vfloat limit;        // nothing beyond this distance counts
    vuint from;          // the flat primitive the ray starts on, which it cannot hit again, or NONE
    vuint to;            // of a shadow ray: the primitive it is aimed at, which cannot shade itself, or NONE
#ifdef OPACITY
    vfloat after;        // only hits behind this distance count, and of hits at it those of primitives with a higher number than this one
    vuint after_primitive;
#endif
#ifdef MOTION
    vfloat time;         // share of the interval that the shutter is open: geometry/motion.h
#endif
} Ray;

typedef struct {
    vfloat distance;     // in multiples of the direction; the limit where nothing was hit
    vuint primitive;     // NONE where nothing was hit
} Hit;

// A ray without end that leaves no surface and is aimed at none.
static Ray ray_make(vec3 origin, vec3 direction) {
    Ray ray;
    ray.origin = origin;
    ray.direction = direction;
    ray.limit = splat(FAR);
    ray.from = ray.to = splat_uint(NONE);
#ifdef OPACITY
    ray.after = splat(BOX_START);
    ray.after_primitive = splat_uint(NONE);
#endif
#ifdef MOTION
    ray.time = splat(0.0f);
#endif
    return ray;
}

// When it is on its way.
#ifdef MOTION
static vfloat ray_time(const Ray* ray) { return ray->time; }
static Ray ray_in_time(Ray given, vfloat time) {
    Ray ray = given;
    ray.time = time;
    return ray;
}
#else
static vfloat ray_time(const Ray* ray) { return splat(0.0f); }
static Ray ray_in_time(Ray ray, vfloat time) { return ray; }
#endif

// Take the other ray where the statement holds.
static void ray_replace(Ray* ray, Ray other, vmask m) {
    ray->origin = choose(m, other.origin, ray->origin);
    ray->direction = choose(m, other.direction, ray->direction);
    ray->limit = m ? other.limit : ray->limit;
    ray->from = m ? other.from : ray->from;
    ray->to = m ? other.to : ray->to;
#ifdef OPACITY
    ray->after = m ? other.after : ray->after;
    ray->after_primitive = m ? other.after_primitive : ray->after_primitive;
#endif
#ifdef MOTION
    ray->time = m ? other.time : ray->time;
#endif
}

// How far from the surface, along its normal, a new ray has to start: enough to be on its side whatever the rounding of the hit
// point. `error` bounds that rounding by component (PBR 4ed, 6.8.6): a multiple of the coordinates involved, so it scales with them.
static vfloat ray_clearance(vec3 normal, vec3 error) {
    return inner(error, vec3_of(absolute(normal.x), absolute(normal.y), absolute(normal.z)));
}
static vec3 ray_leave(vec3 point, vec3 normal, vfloat clearance, vmask inward) {
    return along(point, normal, inward ? -clearance : clearance);
}

// Where a ray from `origin` to a point of a surface ends, so that it meets nothing else in the surface's plane, such as the triangle next to
// it: before the point by the point's own error, and by the error of where a ray that came this far meets the plane. Along the normal that
// is a few roundings of the way, whatever the angle: one of each difference, product, sum and quotient of the triangle's test.
static vec3 ray_end(vec3 origin, vec3 point, vec3 normal, vec3 error) {
    const vec3 to = sub(point, origin);
    const vec3 unsure = along(error, vec3_of(absolute(to.x), absolute(to.y), absolute(to.z)), splat(8.0f * EPSILON));
    return ray_leave(point, normal, ray_clearance(normal, unsure), inner(to, normal) > 0.0f);
}

#ifdef INVARIANTS
// Of a path's ray, whose direction is a unit vector.
static vmask ray_violates(const Ray* ray, vmask where) { return where & !(invariant_unit(ray->direction) & invariant_finite3(ray->origin) & (ray->limit <= FAR)); }
#endif

#endif
