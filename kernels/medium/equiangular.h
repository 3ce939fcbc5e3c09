// Distances in the fog sampled by the angle that they cover as a lamp sees them (Kulla and Fajardo, "Importance sampling techniques for path
// tracing in participating media", EGSR 2012): single scattering of its light has no 1/r² left then.
//
// A lamp is chosen by its power. Free paths are sampled so with a probability, `share`, and else by the extinction; their density is that
// of both ways together, as for a balance heuristic. Light gets endlessly far in the fog, and by the extinction alone so do paths that no
// light reaches.
//
// sample: a distance from the ray's origin, without end. pdf: per metre. beyond: the probability of a longer one. Zero share: no lamp.
#ifndef MEDIUM_EQUIANGULAR_H
#define MEDIUM_EQUIANGULAR_H

#include "light/light.h"
#include "material/interior.h"

#ifdef EQUIANGULAR

// In thin fog most paths have to get through it to surfaces: the share grows with the optical depth from here to the lamp, up to the most.
//
// A weight of this mixture has mean 1 and some variance, and that of a product of n such weights grows exponentially with n, while most
// paths lose their throughput. The share therefore falls with the optical depth between lamp and ray, beyond which 1/r² matters no more,
// and with the events before: the product over all of them has a finite bound, as that of 1 − share has.
#define EQUIANGULAR_MOST 0.3f
#define EQUIANGULAR_GROWTH 1.5f
#define EQUIANGULAR_EVENTS 16.0f           // after which the share is half
#define EQUIANGULAR_LEAST_ANGLE 1.0e-5f    // turns: single precision has no digits left for less
#define EQUIANGULAR_LEAST_DISTANCE 1.0e-4f

typedef struct {
    vfloat share;
    vfloat nearest;          // distance along the ray at which it is nearest to the lamp
    vfloat height;           // how near that is
    vfloat first, angle;     // turns: the ray's origin as the lamp sees it, 0 where it is nearest; all of the ray
} Equiangular;

static Equiangular equiangular_none(void) {
    Equiangular e;
    e.share = e.nearest = e.first = splat(0.0f);
    e.height = splat(1.0f), e.angle = splat(0.25f);
    return e;
}

static Equiangular equiangular_about_lamp(
    const Scene* scene, Sampler sampler, vuint set, vuint depth, const Ray* ray, vfloat extinction, vmask may
) {
    Equiangular e = equiangular_none();
    if (scene->settings->light_count == 0u) return e;

    // Choose a lamp, by random numbers that choose nothing else
    Sampler own = sampler;
    own.seed ^= 0x85ebca6bu;
    vuint bits, unused, rest;
    sampler_hash_bits(own, set, &bits, &unused);
    const LightRow lamp = light_at(scene, may ? light_by_power(scene, bits, own, set, &rest) : splat_uint(0u), ray_time(ray));
    const vmask triangle = lamp.kind == LIGHT_AREA_TRIANGLE;
    const vec3 middle = add(vec3_row(lamp.row, LIGHT_ROW_AB), vec3_row(lamp.row, LIGHT_ROW_AC));
    const vec3 first = vec3_row(lamp.row, LIGHT_ROW_CENTER);             // of a triangle its first corner, of a lamp its position
    const vec3 center = choose(triangle, along(first, middle, splat(0.333333333f)), first);
    const vmask somewhere = !((lamp.kind == LIGHT_DIRECTIONAL) | (lamp.kind == LIGHT_ENVIRONMENT) | (lamp.kind == LIGHT_SUN));

    // See the ray from there
    const vec3 to = sub(center, ray->origin);
    e.nearest = inner(to, ray->direction);
    e.height = greater(magnitude(along(to, ray->direction, -e.nearest)), splat(EQUIANGULAR_LEAST_DISTANCE));
    const vfloat turn = turn_of(e.height, -e.nearest);
    e.first = turn > 0.5f ? turn - 1.0f : turn;
    e.angle = splat(0.25f) - e.first;
    const vmask seen = may & somewhere & (e.angle > EQUIANGULAR_LEAST_ANGLE);
    const vfloat near = lesser(extinction * magnitude(to) * EQUIANGULAR_GROWTH, splat(EQUIANGULAR_MOST));
    const vfloat apart = extinction * e.height, late = vfloat_of(vint_from_uint(depth)) * (1.0f / EQUIANGULAR_EVENTS);
    e.share = seen ? quotient(near, fma(apart, apart, splat(1.0f)) * fma(late, late, splat(1.0f))) : splat(0.0f);
    return e;
}

static vfloat equiangular_sample(const Equiangular* e, vuint bits) {
    const vfloat turn = fma(unit_interval(bits), e->angle, e->first);
    vfloat cosine, sine;
    cos_sin_turn(turn < 0.0f ? turn + 1.0f : turn, &cosine, &sine);
    return bounded(fma(e->height, quotient(sine, greater(cosine, splat(1.0e-9f))), e->nearest), 0.0f, FAR);
}
static vfloat equiangular_pdf(const Equiangular* e, vfloat distance) {
    const vfloat from_nearest = distance - e->nearest;
    return quotient(e->height, e->angle * 6.28318530717959f * fma(from_nearest, from_nearest, e->height * e->height));
}
static vfloat equiangular_beyond(const Equiangular* e, vfloat distance) {
    const vfloat turn = turn_of(e->height, distance - e->nearest), there = turn > 0.5f ? turn - 1.0f : turn;
    return quotient(greater(splat(0.25f) - there, splat(0.0f)), e->angle);
}

#endif

#endif
