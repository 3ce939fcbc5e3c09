// A clear coat: microfacets with Schlick's Fresnel term of an index of 1.5, as glTF's KHR_materials_clearcoat has it. What it does not
// reflect, between its facets either, passes on to what it covers.
// Frame: local, z = shading normal on the side of `wo`. eval: f in 1/sr, without the cosine. pdf: per steradian.
#ifndef MATERIAL_LOBE_COAT_H
#define MATERIAL_LOBE_COAT_H

#include "material/albedo.h"
#include "material/fresnel.h"
#include "material/ggx.h"

#define COAT_F0 0.04f

typedef struct {
    vmask present;
    vfloat share;            // of the surface that has it
    vfloat alpha;
} Coat;

// The share of light along a direction that it reflects.
static vfloat coat_albedo(const Coat* c, __global const float* tables, vfloat cosine) {
    const vfloat all = albedo_ggx(tables, c->alpha, cosine), grazing = albedo_grazing(tables, splat_uint(0u), c->alpha, cosine);
    return c->present ? c->share * all * fma(grazing, splat(1.0f - COAT_F0), splat(COAT_F0)) : splat(0.0f);
}
// Its average.
static vfloat coat_average(const Coat* c, __global const float* tables) {
    const vfloat kept = splat(1.0f) - albedo_ggx_lost(tables, c->alpha);
    return c->present ? c->share * fma(albedo_grazing_average(tables, splat_uint(0u), c->alpha), splat(1.0f - COAT_F0), kept * COAT_F0) : splat(0.0f);
}

static Alpha coat_facets(const Coat* c) {
    Alpha a;
    a.x = a.y = c->alpha;
    return a;
}

// `wm`: the normal between `wo` and `wi`.
static vfloat coat_eval(const Coat* c, vec3 wm, vec3 wo, vec3 wi, vfloat* pdf) {
    const vfloat once = ggx_reflection(coat_facets(c), wo, wi, wm, pdf);
    const vfloat fresnel = fma(fresnel_grazing(bounded(inner(wo, wm), 0.0f, 1.0f)), splat(1.0f - COAT_F0), splat(COAT_F0));
    *pdf = c->present ? *pdf : splat(0.0f);
    return c->present ? c->share * fresnel * once : splat(0.0f);
}

#endif
