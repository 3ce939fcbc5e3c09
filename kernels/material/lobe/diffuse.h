// Diffuse reflection, rough or not (material/eon.h), below a layer that reflects by Schlick's Fresnel term and passes on what it does
// not reflect: E_layer(μ) of the light along each direction. The layer takes its share once as light arrives and once as it leaves,
//     f = f_diffuse (1 − E_layer(μo)) (1 − E_layer(μi)) / (1 − E_layer,avg),
// which is reciprocal, and with a white Lambertian surface below loses nothing (Kelemen & Szirmay-Kalos, Eurographics 2001).
#ifndef MATERIAL_LOBE_DIFFUSE_H
#define MATERIAL_LOBE_DIFFUSE_H

#include "material/albedo.h"
#include "material/eon.h"

typedef struct {
    vmask there;
    vec3 color;              // times its share of the surface
    vfloat roughness;        // r of EON
    vmask covered;           // there is such a layer
    vec3 f0, f90;            // of the layer
    vec3 passed;             // (1 − E_layer(μo)) / (1 − E_layer,avg)
} Diffuse;

static vec3 diffuse_layer(const Diffuse* d, vfloat all, vfloat grazing) { return along(scale(d->f0, all), sub(d->f90, d->f0), grazing); }

// `all`, `grazing`: of the layer along `wo` (albedo_ggx).
static void diffuse_cover(Diffuse* d, __global const float* tables, vfloat alpha, vfloat all, vfloat grazing) {
    const vfloat average = splat(1.0f) - albedo_ggx_lost(tables, alpha);
    const vfloat average_grazing = albedo_line(tables, splat_uint(ALBEDO_GGX_SCHLICK), GGX_TABLE_SIZE, alpha);
    const vec3 one = vec3_all(1.0f), passes = sub(one, diffuse_layer(d, average, average_grazing));
    const vec3 inverse = vec3_of(inverse_or_one(passes.x), inverse_or_one(passes.y), inverse_or_one(passes.z));
    d->passed = choose(d->covered, mul(sub(one, diffuse_layer(d, all, grazing)), inverse), one);
}

// f in 1/sr; `all`, `grazing` of the layer along `wi`.
static vec3 diffuse_eval(const Diffuse* d, vec3 wo, vec3 wi, vfloat all, vfloat grazing) {
    const vec3 below = sub(vec3_all(1.0f), diffuse_layer(d, all, grazing));
    const vec3 f = eon_eval(d->color, d->roughness, wo, wi);
    return choose(d->there, mul(f, choose(d->covered, mul(d->passed, below), vec3_all(1.0f))), vec3_all(0.0f));
}

#endif
