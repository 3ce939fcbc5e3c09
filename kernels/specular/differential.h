// How the ray at the end of a chain changes with the direction in which the chain begins: ray differentials (Igehy, "Tracing ray differentials", SIGGRAPH
// 1999).
#ifndef SPECULAR_DIFFERENTIAL_H
#define SPECULAR_DIFFERENTIAL_H

#include "geometry/curvature.h"
#include "material/bsdf.h"
#include "specular/delta.h"

// Of a ray's origin and direction, by steps of the first direction along two axes across it.
typedef struct {
    vec3 point[2], direction[2];
} Differential;

static Differential differential_begin(vec3 direction) {
    const Frame axes = frame_around(direction);
    Differential d;
    d.point[0] = d.point[1] = vec3_all(0.0f);
    d.direction[0] = axes.tangent, d.direction[1] = axes.bitangent;
    return d;
}

// The ray begins so much further on.
static void differential_advance(Differential* d, vfloat distance, vmask where) {
    for (int i = 0; i < 2; ++i) d->point[i] = choose(where, along(d->point[i], d->direction[i], distance), d->point[i]);
}

// The ray, having come to a vertex of the chain along this direction, goes on by reflection or through it.
static void differential_meet(const Scene* scene, Differential* d, const Surface* s, const Bsdf* b, vec3 direction, vfloat distance, vmask through,
                              vmask where) {
    const vfloat slope = inner(direction, s->normal), inverse = quotient(splat(1.0f), where & (slope != 0.0f) ? slope : splat(1.0f));
    const Curvature curvature = curvature_at(scene, s, where);
    for (int i = 0; i < 2; ++i) {
        const vec3 moved = along(d->point[i], d->direction[i], distance);
        const vec3 step = along(moved, direction, -inner(moved, s->normal) * inverse);
        const vec3 turn = curvature_change(&curvature, s, step), d_normal = choose(s->front, turn, negate(turn));
        d->point[i] = choose(where, step, d->point[i]);
        d->direction[i] = choose(where, delta_change(b, through, direction, d->direction[i], d_normal), d->direction[i]);
    }
}

// The matrix by which steps of the first direction move the point at a distance along the ray, across it, over that distance; `nearness`: one over it, 0
// for what is infinitely far.
typedef struct {
    Frame across;
    vfloat xx, xy, yx, yy, determinant;
} DifferentialMap;

static DifferentialMap differential_map(const Differential* d, vec3 direction, vfloat nearness) {
    DifferentialMap m;
    m.across = frame_around(direction);
    const vec3 first = along(d->direction[0], d->point[0], nearness), second = along(d->direction[1], d->point[1], nearness);
    m.xx = inner(first, m.across.tangent), m.yx = inner(first, m.across.bitangent);
    m.xy = inner(second, m.across.tangent), m.yy = inner(second, m.across.bitangent);
    m.determinant = difference_of_products(m.xx, m.yy, m.xy, m.yx);
    return m;
}

#define DIFFERENTIAL_SINGULAR 1.0e-12f

// Density of first directions, per steradian, over that of the points there, across the ray and per square metre; from far, over directions there.
static vfloat differential_density(const DifferentialMap* m, vfloat nearness, vmask infinite) {
    const vfloat inverse = quotient(splat(1.0f), greater(absolute(m->determinant), splat(DIFFERENTIAL_SINGULAR)));
    return inverse * (infinite ? splat(1.0f) : nearness * nearness);
}

#endif
