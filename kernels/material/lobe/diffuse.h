// Diffuse reflection, rough or not (material/eon.h), below a layer that reflects by Schlick's Fresnel term and passes on what it does
// not reflect, and below sheen and coat that do the same. Each layer takes its share E(μ) once as light arrives and once as it leaves:
// with T the product of all 1 − E,
//     f = f_diffuse T(μo) T(μi) / (T_avg (1 + ε)),
// which is reciprocal, and with a white Lambertian surface below one layer loses nothing (Kelemen & Szirmay-Kalos, Eurographics 2001).
// For T_avg stands the product of the layers' averages; ε is a bound of what their being alike adds to it, so that no energy is gained.
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
    vec3 passed;             // T(μo) / (T_avg (1 + ε)) of the layer
    vfloat under;            // the same of sheen and coat
} Diffuse;

// Both layers' shares vary alike: they are those of grazing light. For smooth layers ∫ T² over (∫ T)² is 1.0142; sheen of any roughness
// below such a layer, 1.032; the loss of EON, which is at most 0.2235 of it, adds 0.03 of itself, and below sheen 0.0565.
#define DIFFUSE_ALIKE 0.0143f
#define DIFFUSE_ALIKE_SHEEN 0.032f
#define DIFFUSE_ALIKE_EON 0.0068f
#define DIFFUSE_ALIKE_EON_SHEEN 0.0127f

static vec3 diffuse_layer(const Diffuse* d, vfloat all, vfloat grazing) { return along(scale(d->f0, all), sub(d->f90, d->f0), all * grazing); }

// `all`, `grazing`: E and B / E of the layer along `wo` (material/albedo.h); `kept` is E_avg.
static void diffuse_cover(Diffuse* d, __global const float* tables, vfloat alpha, vfloat kept, vfloat all, vfloat grazing) {
    const vec3 average = along(scale(d->f0, kept), sub(d->f90, d->f0), albedo_grazing_average(tables, alpha));
    const vec3 one = vec3_all(1.0f), passes = scale(sub(one, average), fma(d->roughness, splat(DIFFUSE_ALIKE_EON), splat(1.0f)));
    const vec3 inverse = vec3_of(inverse_or_one(passes.x), inverse_or_one(passes.y), inverse_or_one(passes.z));
    d->passed = choose(d->covered, mul(sub(one, diffuse_layer(d, all, grazing)), inverse), one);
}

// f in 1/sr; `all`, `grazing` of the layer along `wi`, and `left` by sheen and coat.
static vec3 diffuse_eval(const Diffuse* d, vec3 wo, vec3 wi, vfloat all, vfloat grazing, vfloat left) {
    const vec3 below = sub(vec3_all(1.0f), diffuse_layer(d, all, grazing));
    const vec3 f = scale(eon_eval(d->color, d->roughness, wo, wi), d->under * left);
    return choose(d->there, mul(f, choose(d->covered, mul(d->passed, below), vec3_all(1.0f))), vec3_all(0.0f));
}

#endif
