// Lights that are surfaces: triangles, spheres, disks. Each shines uniformly from its front.
//
// sample: a point on the light for a point in space, from two numbers in [0, 1). pdf: of the direction to a point of it, per
// steradian as seen from there. Zero: the light is seen from behind or edge-on.
#ifndef LIGHT_AREA_H
#define LIGHT_AREA_H

#include "core/frame.h"
#include "core/warp.h"
#include "geometry/wide.h"

typedef struct {
    vec3 point;          // on the light
    vec3 normal;         // of its front, unit
    vec3 error;          // bound of the point's rounding error, by component
    vfloat pdf;          // per steradian
} AreaSample;

// Density by area, 1/area, turned into density by solid angle, for the point of the light `to` away from where it is seen.
static vfloat area_pdf(vec3 to, vec3 normal, vfloat inverse_area) {
    const vfloat distance2 = inner(to, to), slope = -inner(to, normal);      // the distance times the cosine at the light
    const vmask seen = slope > 0.0f;
    return seen ? quotient(distance2 * square_root(distance2) * inverse_area, seen ? slope : splat(1.0f)) : splat(0.0f);
}

// `inverse` is one over the length of ab × ac.
static AreaSample triangle_sample(vec3 origin, vec3 a, vec3 ab, vec3 ac, vfloat inverse, vfloat u, vfloat v) {
    vfloat weight_b, weight_c;
    warp_triangle(u, v, &weight_b, &weight_c);
    AreaSample s;
    s.point = along(along(a, ab, weight_b), ac, weight_c);
    s.normal = scale(outer(ab, ac), inverse);
    s.error = scale(vec3_of(absolute(a.x) + absolute(ab.x) + absolute(ac.x), absolute(a.y) + absolute(ab.y) + absolute(ac.y),
                            absolute(a.z) + absolute(ab.z) + absolute(ac.z)),
                    splat(8.0f * EPSILON));
    s.pdf = area_pdf(sub(s.point, origin), s.normal, inverse * 2.0f);
    return s;
}

// 1 − cosθ of the cone a sphere fills from a point outside it; 0 inside.
static vfloat sphere_spread(vec3 origin, vec3 center, vfloat radius) {
    const vec3 to = sub(center, origin);
    const vfloat distance2 = inner(to, to);
    const vfloat sine2 = quotient(radius * radius, distance2 > 0.0f ? distance2 : splat(1.0f));
    const vmask outside = distance2 > radius * radius;
    return outside ? quotient(sine2, splat(1.0f) + root(splat(1.0f) - sine2)) : splat(0.0f);
}

// A sphere that shines outwards is sampled by the cone that it fills, from outside it; one that shines inwards by its area, from inside
// and, as its near side may have holes, from outside.
static vfloat sphere_pdf(vec3 origin, vec3 center, vfloat radius, vfloat facing, vec3 point, vec3 normal) {
    const vfloat spread = sphere_spread(origin, center, radius);
    const vfloat cone = spread > 0.0f ? warp_cone_pdf(spread > 0.0f ? spread : splat(1.0f)) : splat(0.0f);
    const vfloat area = area_pdf(sub(point, origin), normal, inverse_or_one(radius * radius * (4.0f * PI)));
    return facing > 0.0f ? cone : area;
}

// How far beyond the sphere an origin may seem to lie that is on it, as a factor of the distance's square.
#define SPHERE_ROUNDING 1.00001f

// Whether the side of the sphere that shines is all around the origin or turned to it: `facing` = +1, from outside; −1, from inside, and
// from points of the sphere itself, which may lie to either side of it by a rounding.
static vmask sphere_shines_on(vec3 origin, vec3 center, vfloat radius, vfloat facing) {
    const vec3 to = sub(center, origin);
    const vfloat distance2 = inner(to, to), radius2 = radius * radius;
    return ((facing > 0.0f) & (distance2 > radius2)) | ((facing < 0.0f) & (distance2 <= radius2 * SPHERE_ROUNDING));
}

static AreaSample sphere_sample(vec3 origin, vec3 center, vfloat radius, vfloat facing, vfloat u, vfloat v) {
    const vfloat spread = sphere_spread(origin, center, radius);
    const vec3 to = sub(center, origin);
    const vec3 direction = frame_to_world(frame_around(unit(to)), warp_cone(u, v, spread));
    vfloat distance;
    const vmask hit = sphere_hit_lanes(to.x, to.y, to.z, radius, direction.x, direction.y, direction.z, splat(1.0f), splat(0.0f), &distance);
    const vfloat at = hit ? distance : inner(to, direction);       // the cone's rim may miss by a rounding
    const vec3 seen = unit(sub(along(origin, direction, at), center));
    const vec3 outward = choose(facing > 0.0f, seen, warp_sphere(u, v));
    AreaSample s;
    s.point = along(center, outward, radius);
    s.normal = scale(outward, facing);
    s.error = scale(vec3_of(absolute(center.x) + radius, absolute(center.y) + radius, absolute(center.z) + radius),
                    splat(8.0f * EPSILON));
    s.pdf = sphere_pdf(origin, center, radius, facing, s.point, s.normal);
    return s;
}

static AreaSample disk_sample(vec3 origin, vec3 center, vfloat radius, vec3 normal, vfloat u, vfloat v) {
    vfloat x, y;
    warp_disk(u, v, &x, &y);
    const Frame f = frame_around(normal);
    AreaSample s;
    s.point = along(along(center, f.tangent, x * radius), f.bitangent, y * radius);
    s.normal = normal;
    s.error = scale(vec3_of(absolute(center.x) + radius, absolute(center.y) + radius, absolute(center.z) + radius),
                    splat(8.0f * EPSILON));
    s.pdf = area_pdf(sub(s.point, origin), normal, inverse_or_one(radius * radius * PI));
    return s;
}

static AreaSample area_sample_choose(vmask m, AreaSample yes, AreaSample no) {
    AreaSample s;
    s.point = choose(m, yes.point, no.point);
    s.normal = choose(m, yes.normal, no.normal);
    s.error = choose(m, yes.error, no.error);
    s.pdf = m ? yes.pdf : no.pdf;
    return s;
}

#endif
