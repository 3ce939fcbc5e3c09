// The point that a ray has found on a curve.
//
// Where along the curve it is, is found again as the ray's test found it (geometry/curve.inc), in the space of its group. The point is then put on
// the sphere around that point of the curve, so that it is as good as single precision however far the ray came.
#ifndef GEOMETRY_CURVE_H
#define GEOMETRY_CURVE_H

#include "core/frame.h"
#include "geometry/instance.h"
#include "geometry/ray.h"
#include "geometry/wide.h"
#include "scene.h"

#ifdef CURVES

typedef struct {
    vec3 point, normal, tangent;     // in the world, the latter two unit vectors
    vec3 error;                      // of the point, as in Surface, in the space of its group
    vfloat along;                    // where it is from the beginning of the curve, 0, to its end, 1
    vfloat radius;                   // in the world
    vfloat pace;                     // so far it runs along the tangent from beginning to end, metres, were it as straight as here
} CurvePoint;

// What is a curve has a number of its own in the row of its primitive.
static vmask curve_is(const vfloat row[16], vmask round) { return round & (row[PRIMITIVE_ROW_FACING] >= (float)ANALYTIC_SHAPE_CURVE); }

static CurvePoint curve_point(const Scene* scene, const Ray* ray, const Placed* placed, vmask curve) {
    vfloat k[CURVE_WORDS];
    vec3 o = ray->origin, d = ray->direction;
#ifdef INSTANCES
    if (lane_any(placed->present)) {
        o = choose(placed->present, placed_point(placed->instance + INSTANCE_ROW_TO_OBJECT, o), o);
        d = choose(placed->present, placed_vector(placed->instance + INSTANCE_ROW_TO_OBJECT, d), d);
    }
#endif
    lane_rows(scene->curve_rows, curve ? placed->row - scene->settings->triangle_count : splat_uint(0u), k);
    CurveHit_lanes hit;
    curve_hit_lanes(k, o.x, o.y, o.z, d.x, d.y, d.z, ray_inverse2_lanes(d.x, d.y, d.z), splat(-FAR), &hit);
    const vec3 center = vec3_of(curve_at_lanes(k, hit.u), curve_at_lanes(k + 1, hit.u), curve_at_lanes(k + 2, hit.u));
    const vec3 slope = vec3_of(curve_slope_lanes(k, hit.u), curve_slope_lanes(k + 1, hit.u), curve_slope_lanes(k + 2, hit.u));
    const vec3 out = vec3_of(hit.nx, hit.ny, hit.nz);
    // Where rounding lets the second look miss, the side that the ray came from
    const vec3 side = choose(inner(out, out) > 1.0e-30f, out, negate(d));
    const vec3 outward = unit(side);
    CurvePoint p;
    p.along = hit.u;
    p.radius = curve_at_lanes(k + 3, hit.u);
    p.point = along(center, outward, p.radius);
    p.normal = outward;
    p.tangent = slope;
    p.error = scale(vec3_of(absolute(k[0]) + absolute(k[4]) + absolute(k[8]) + absolute(k[12]) + p.radius,
                            absolute(k[1]) + absolute(k[5]) + absolute(k[9]) + absolute(k[13]) + p.radius,
                            absolute(k[2]) + absolute(k[6]) + absolute(k[10]) + absolute(k[14]) + p.radius),
                    splat(16.0f * EPSILON));
#ifdef INSTANCES
    if (lane_any(placed->present)) {
        p.point = choose(placed->present, placed_point(placed->placement + PLACEMENT_ROW_TO_WORLD, p.point), p.point);
        const vec3 turned = placed_normal(placed, outward);
        p.normal = choose(placed->present, unit(turned), outward);
        p.radius = p.radius * (placed->present ? placed->placement[PLACEMENT_ROW_SCALE] : splat(1.0f));
        p.tangent = choose(placed->present, placed_vector(placed->placement + PLACEMENT_ROW_TO_WORLD, slope), slope);
    }
#endif
    // Square to the normal, where the curve has a direction at all
    const vec3 flat = along(p.tangent, p.normal, -inner(p.tangent, p.normal));
    const vec3 any = frame_around(p.normal).tangent;
    const vmask runs = inner(flat, flat) > 1.0e-12f * inner(p.tangent, p.tangent);
    const vec3 chosen = choose(runs & (inner(flat, flat) > 0.0f), flat, any);
    const vec3 slope_there = p.tangent;
    p.tangent = unit(chosen);
    p.pace = runs ? inner(slope_there, p.tangent) : splat(1.0f);
    return p;
}

#endif

#endif
