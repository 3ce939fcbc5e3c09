// Every scatterer behind one triple: bsdf_sample, bsdf_eval, bsdf_pdf. World space; directions point away from the surface.
#ifndef MATERIAL_BSDF_H
#define MATERIAL_BSDF_H

#include "core/frame.h"
#include "core/sampler.h"
#include "geometry/surface.h"
#include "material/dielectric.h"
#include "material/lambert.h"
#include "material/mirror.h"

typedef struct {
    Frame frame;         // around the shading normal, on the side of wo
    vec3 wo;             // local, towards where the light is seen from
    vec3 side;           // geometric normal on the side of wo
    vec3 color;
    vfloat eta;          // index beyond over index on wo's side
    vuint kind;
    vmask specular;      // all of it is a delta: only sampling it finds where light comes from
} Bsdf;

typedef struct {
    vec3 direction;      // unit, world
    vec3 weight;         // f |cosθ| / pdf; zero ends the path
    vfloat pdf;          // per steradian; 0 where the BSDF is specular (but whether it is, the mask says)
} BsdfSample;

static Bsdf bsdf_at(const Surface* s, vec3 direction) {
    Bsdf b;
    b.side = choose(s->front, s->normal, negate(s->normal));
    b.frame = frame_around(choose(s->front, s->shading, negate(s->shading)));
    b.wo = frame_to_local(b.frame, negate(direction));
    b.wo.z = greater(b.wo.z, splat(1.0e-7f));      // an interpolated normal may look away from the viewer
    b.color = s->color;
    b.eta = s->front ? s->ior : splat(1.0f) / s->ior;
    b.kind = s->kind;
    b.specular = s->kind != MATERIAL_LAMBERT;
    return b;
}

// The normal of the side that light has to arrive on to be scattered; zero: on either.
static vec3 bsdf_receives(const Bsdf* b) { return choose(b->kind == MATERIAL_DIELECTRIC, vec3_all(0.0f), b->side); }

// f in 1/sr times |cosθ|, and the density with which bsdf_sample chooses `direction`.
static vec3 bsdf_eval(const Bsdf* b, vec3 direction, vfloat* pdf) {
    const vec3 wi = frame_to_local(b->frame, direction);
    const vmask seen = !b->specular & (inner(direction, b->side) > 0.0f);
    *pdf = seen ? lambert_pdf(wi) : splat(0.0f);
    const vec3 f = scale(lambert_eval(b->color, wi), greater(wi.z, splat(0.0f)));
    return choose(seen, f, vec3_all(0.0f));
}

static BsdfSample bsdf_sample(const Bsdf* b, vuint bits_u, vuint bits_v) {
    const vfloat u = unit_interval(bits_u), v = unit_interval(bits_v);
    BsdfSample s;
    vec3 wi;
    s.weight = lambert_sample(b->color, u, v, &wi);
    s.pdf = lambert_pdf(wi);
    const vmask delta = b->specular;
    if (lane_any(delta)) {
        vec3 mirrored, through;
        const vec3 mirror_weight = mirror_sample(b->color, b->wo, &mirrored);
        const vec3 glass_weight = dielectric_sample(b->color, b->eta, b->wo, u, &through);
        const vmask mirror = b->kind == MATERIAL_MIRROR;
        wi = choose(delta, choose(mirror, mirrored, through), wi);
        s.weight = choose(delta, choose(mirror, mirror_weight, glass_weight), s.weight);
        s.pdf = delta ? splat(0.0f) : s.pdf;
    }
    s.direction = direction_again(frame_to_world(b->frame, wi));
    // A direction on the other side of the geometry than it is of the shading normal carries no light.
    const vmask crossed = (inner(s.direction, b->side) > 0.0f) != (wi.z > 0.0f);
    s.weight = choose(crossed, vec3_all(0.0f), s.weight);
    return s;
}

#endif
