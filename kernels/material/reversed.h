// A BSDF seen from its other end: what a surface scatters to where a path goes on, of the light from where it came. For paths that come from
// the lights, and for the density with which a path from the other end would have gone the other way.
#ifndef MATERIAL_REVERSED_H
#define MATERIAL_REVERSED_H

#include "material/bsdf.h"

#if defined(MATERIALS) || defined(TEXTURES)
#define BSDF_MADE_AGAIN
// Of what has lobes, passes light on, or has its normal bent: the BSDF is made again as it is seen from there.
__attribute__((noinline)) static vec3 bsdf_made_again(const Scene* scene, const Surface* surface, vec3 from, vec3 to, vfloat* pdf) {
    Surface seen = *surface;
    Bsdf again;
    seen.front = inner(surface->normal, to) > 0.0f;
    bsdf_at(scene, &seen, negate(to), &again);
    return bsdf_eval(&again, from, pdf);
}
#endif

// Whether the normal is bent towards who looks at it, as that of a map is, and an interpolated one of what is glossy.
static vmask bsdf_is_bent(const Surface* s, const Bsdf* b) {
    const vec3 own = choose(s->front, s->shading, negate(s->shading)), normal = b->frame.normal;
    return (normal.x != own.x) | (normal.y != own.y) | (normal.z != own.z);
}

// Where that makes a difference.
static vmask bsdf_is_one_sided(const Surface* s, const Bsdf* b) {
    vmask differs = bsdf_passes(b);
#ifdef MATERIALS
    differs = differs | b->closure.present;
#endif
#ifdef TEXTURES
    differs = differs | bsdf_is_bent(s, b);
#endif
    return differs;
}

// f in 1/sr times |cosθ| of `from`, for radiance that comes from there and leaves towards `to`, and the density with which a path that
// comes from `to` would go there. `b` is the BSDF as it is seen along `from`. Unit vectors away from the surface. Deltas do not count.
static vec3 bsdf_reversed(const Scene* scene, const Surface* surface, const Bsdf* b, vec3 from, vec3 to, vmask where, vfloat* pdf) {
    const vfloat cosine = greater(inner(from, b->frame.normal), splat(0.0f));
    const vmask seen = inner(to, b->side) > 0.0f;
    const vfloat phase = phase_eval(bsdf_mean_cosine(b), -inner(from, to));
    const vmask medium = bsdf_in_medium(b);
    vec3 f = choose(seen, scale(b->color, cosine * INV_PI), vec3_all(0.0f));
    f = choose(medium, vec3_of(phase, phase, phase), f);
    *pdf = medium ? phase : seen ? cosine * INV_PI : splat(0.0f);
#ifdef BSDF_MADE_AGAIN
    const vmask again = where & bsdf_is_one_sided(surface, b) & !medium;
    if (lane_any(again)) {
        vfloat density;
        f = choose(again, bsdf_made_again(scene, surface, from, to, &density), f);
        *pdf = again ? density : *pdf;
    }
#ifdef CURVES
    // From there another place of the curve is seen
    const vmask behind = surface->curve & !seen & !medium;
    f = choose(behind, vec3_all(0.0f), f);
    *pdf = behind ? splat(0.0f) : *pdf;
#endif
#endif
    return f;
}

#endif
