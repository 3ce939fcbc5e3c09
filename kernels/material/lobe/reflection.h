// Reflection by microfacets (material/ggx.h, beckmann.h): of metals by Fresnel's equations for a complex index of refraction, and of anything by
// Schlick's approximation. What metals reflect more than once between facets is added by a second, diffuse lobe (Kulla & Conti,
// SIGGRAPH course 2017), so that roughness loses no energy; below other surfaces it goes to what lies there.
// Frame: local, z = shading normal on the side of `wo`. eval: f in 1/sr, without the cosine. pdf: per steradian.
#ifndef MATERIAL_LOBE_REFLECTION_H
#define MATERIAL_LOBE_REFLECTION_H

#include "material/albedo.h"
#include "material/beckmann.h"
#include "material/fresnel.h"
#include "material/thin_film.h"

typedef struct {
    vmask present;
    vmask measured;          // by eta and k; else Schlick
    vmask beckmann;          // the facets' distribution; else GGX
    vec3 f0, f90;            // times their share of the surface; where measured: eta and k
    vec3 multiple;           // scale of the second lobe: F_ms / (π (1 − E_avg)) times the share of metal
    vfloat missing;          // 1 − E(μo); 0 where facets reflect once only
#ifdef IRIDESCENCE
    ThinFilm film;           // that lies on it; what is below, if not measured:
    vec3 metal;              // color of metal,
    vec3 layer_f0, layer_f90;    // the layer above what is diffuse,
    vfloat metallic, layered;    // and the share of the surface that each has
#endif
} Reflection;

// Scale of the second lobe of a metal with that average Fresnel term.
static vfloat reflection_multiple_of(vfloat average, vfloat lost) {
    const vfloat kept = splat(1.0f) - lost;
    return quotient(average * average * kept, (splat(1.0f) - average * lost) * greater(lost, splat(1.0e-7f))) * INV_PI;
}
static vec3 reflection_multiple(vec3 average, vfloat lost) {
    return vec3_of(reflection_multiple_of(average.x, lost), reflection_multiple_of(average.y, lost), reflection_multiple_of(average.z, lost));
}

#ifdef IRIDESCENCE
// Of metal and of the layer below the film.
static vec3 reflection_filmed(const Reflection* r, vfloat cosine) {
    vec3 f = vec3_all(0.0f);
    if (lane_any(r->metallic > 0.0f)) f = scale(thin_film_schlick(&r->film, r->metal, vec3_all(1.0f), cosine), r->metallic);
    if (lane_any(r->layered > 0.0f)) f = along(f, thin_film_schlick(&r->film, r->layer_f0, r->layer_f90, cosine), r->layered);
    return f;
}
#endif

static vec3 reflection_fresnel(const Reflection* r, vfloat cosine) {
    vec3 f = fresnel_schlick(r->f0, r->f90, cosine);
    if (lane_any(r->measured)) f = choose(r->measured, fresnel_metal(r->f0, r->f90, cosine), f);
#ifdef IRIDESCENCE
    const vmask filmed = r->film.present;
    if (lane_any(filmed)) {
        const vec3 bare = f;
        f = choose(filmed & !r->measured, reflection_filmed(r, cosine), f);
        const vmask index = filmed & r->measured;
        if (lane_any(index)) f = choose(index, thin_film_reflects(&r->film, r->f0, r->f90, cosine, bare), f);
    }
#endif
    return f;
}

// `wm`: the normal between `wo` and `wi`. `missing`: 1 − E(μi). The density is that of the first lobe.
static vec3 reflection_eval(const Reflection* r, Alpha a, vec3 wm, vec3 wo, vec3 wi, vfloat missing, vfloat* pdf) {
    vfloat once = ggx_reflection(a, wo, wi, wm, pdf);
    if (lane_any(r->beckmann)) once = r->beckmann ? once * beckmann_over_ggx(a, wo, wi, wm) : once;
    const vec3 f = scale(reflection_fresnel(r, bounded(inner(wo, wm), 0.0f, 1.0f)), once);
    *pdf = r->present ? *pdf : splat(0.0f);
    return choose(r->present, along(f, r->multiple, r->missing * missing), vec3_all(0.0f));
}

#endif
