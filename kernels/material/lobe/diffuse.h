// Diffuse reflection and transmission, rough or not (material/eon.h), below a layer that reflects by Schlick's Fresnel term, below sheen and a
// coat. Light crosses the layers twice. With T(μ) the product of all 1 − E(μ), and T_avg its average, weighted by the cosine,
//
//     f = f_eon T(μo) T(μi) / T_avg,                                                                       (1)
//
// which is reciprocal, and over a white Lambertian surface conserves energy (Kelemen & Szirmay-Kalos, Eurographics 2001). The layers' T are
// correlated, so that T_avg is not the product of their averages: it follows from how each varies with μ (Slant, material/albedo.h).
//
// EON is not Lambertian: f_eon = (1 + r A Q(μo, μi)) / π. Energy is conserved if T / √T_avg is replaced by the function a with
//
//     a(μo) ∫ f_eon a(μi) μi dωi = T(μo),        a = T (1 + y) / √T_avg,        y ≈ x + x²,                 (2)
//
// where x = −r A (QT)(μo) / T_avg, less half of that function's average. QT lies in the span of two functions Qb and Qc and of constants.
#ifndef MATERIAL_LOBE_DIFFUSE_H
#define MATERIAL_LOBE_DIFFUSE_H

#include "material/albedo.h"
#include "material/eon.h"

typedef struct {
    vmask present;
    vec3 color;
    vfloat share;            // of the surface
    vfloat transmission;     // of that, the share of light that leaves on the other side
    vec3 transmission_color;
    vfloat roughness;        // r of EON
    vmask covered;           // there is a reflecting layer
    vec3 f0, f90;            // of the layer
    vec3 transmitted;        // T(μo) (1 + y(μo)) / T_avg of all layers
    vec3 x_b, x_c, x_1;      // of x of (2): along Qb, Qc and 1
    vmask corrected;         // by y, which elsewhere is 0
} Diffuse;

// Sheen and coat, or either, above: T_avg of each, and how it varies, over that.
typedef struct {
    vfloat sheen_average, coat_average;
    Slant sheen, coat;
} Covers;

// Times r over alpha of sheen: narrow sheen varies by more than b and c can say, and of what is below up to so much would be gained.
#define DIFFUSE_SHEEN_SLACK 4.0e-6f

// E of the reflecting layer: f0 E + (f90 − f0) B. `albedo`, `grazing`: E and B / E of its facets (material/albedo.h).
static vec3 diffuse_layer_albedo(const Diffuse* d, vfloat albedo, vfloat grazing) {
    return along(scale(d->f0, albedo), sub(d->f90, d->f0), albedo * grazing);
}

// y(μ) of (2).
static vec3 diffuse_correction(const Diffuse* d, __global const float* tables, vfloat cosine) {
    __global const float* n = tables + ALBEDO_SLANT_NUMBERS;
    vfloat qb = splat(n[11]), qc = splat(n[16]);
    for (int k = 10; k >= 5; --k) qb = fma(qb, cosine, splat(n[k]));
    for (int k = 15; k >= 12; --k) qc = fma(qc, cosine, splat(n[k]));
    const vec3 x = along(along(d->x_1, d->x_b, qb), d->x_c, qc);
    return add(x, mul(x, x));
}

// For one colour T_avg of all layers over the product of their averages; and x. `eon`: r A.
static vfloat diffuse_correlation(Slant layer, const Covers* over, __global const float* tables, vfloat eon, vfloat* x_b, vfloat* x_c, vfloat* x_1) {
    __global const float* n = tables + ALBEDO_SLANT_NUMBERS;
    const Slant s = over->sheen, c = over->coat;
    const vfloat upper = s.b * c.b, both = s.b + c.b, pairs = fma(layer.b, both, upper);
    const vfloat correlation = fma(layer.c, s.c + c.c, fma(s.c, c.c, pairs)) + fma(upper * layer.b, splat(-n[0]), splat(1.0f));
    const vfloat b = fma(pairs, splat(-n[0]), layer.b + both), e = fma(pairs, splat(-n[1]), layer.c + s.c + c.c);
    const vfloat q = quotient(eon, correlation);
    *x_b = q * fma(-q, fma(b, splat(n[2]), e * n[3]), b), *x_c = q * fma(-q, fma(b, splat(n[3]), e * n[4]), e);
    *x_1 = quotient(q * fma(b, fma(b, splat(n[2]), e * (n[3] + n[3])), e * e * n[4]), correlation * 2.0f);
    return correlation;
}

// What the layer reflects of diffuse light. `average`: E_avg of its facets.
static vec3 diffuse_layer_average(const Diffuse* d, __global const float* tables, const Facets* facets, vfloat average) {
    return along(scale(d->f0, average), sub(d->f90, d->f0), albedo_grazing_average(tables, facets->base, facets->mean));
}

// Along `wo`, whose cosine is given. `layer`, `reflected`: what the layer reflects of light along `wo`, and of diffuse light; `transmittance`: T of
// sheen and coat.
static void diffuse_cover(Diffuse* d, const Covers* over, __global const float* tables, const Facets* facets, vec3 reflected, vec3 layer,
                          vfloat transmittance, vfloat cosine) {
    const vfloat alpha = facets->mean;
    const vec3 one = vec3_all(1.0f);
    const vec3 left = sub(one, reflected), inverse = vec3_of(inverse_or_one(left.x), inverse_or_one(left.y), inverse_or_one(left.z));
    const Slant e = albedo_facets_slant(tables, facets->base, 0u, alpha), g = albedo_facets_slant(tables, facets->base, 1u, alpha);
    const vec3 b = mul(along(scale(d->f0, e.b), sub(d->f90, d->f0), g.b), inverse), c = mul(along(scale(d->f0, e.c), sub(d->f90, d->f0), g.c), inverse);
    const vfloat eon = quotient(d->roughness, fma(d->roughness, splat(EON_C1), splat(1.0f)));
    const Slant x = {b.x, c.x}, y = {b.y, c.y}, z = {b.z, c.z};
    vec3 correlation;
    correlation.x = diffuse_correlation(x, over, tables, eon, &d->x_b.x, &d->x_c.x, &d->x_1.x);
    correlation.y = diffuse_correlation(y, over, tables, eon, &d->x_b.y, &d->x_c.y, &d->x_1.y);
    correlation.z = diffuse_correlation(z, over, tables, eon, &d->x_b.z, &d->x_c.z, &d->x_1.z);
    d->corrected = d->covered & (d->roughness > 0.0f);
    const vfloat covers = quotient(transmittance, over->sheen_average * over->coat_average);
    vec3 t = scale(mul(sub(one, layer), inverse), covers);
    t = vec3_of(quotient(t.x, correlation.x), quotient(t.y, correlation.y), quotient(t.z, correlation.z));
    if (lane_any(d->corrected)) t = choose(d->corrected, add(t, mul(t, diffuse_correction(d, tables, cosine))), t);
    d->transmitted = choose(d->covered, t, one);
}

// The share of the surface whose light leaves on this side (`above`) or the other.
static vfloat diffuse_share(const Diffuse* d, vmask above) { return d->share * (above ? splat(1.0f) - d->transmission : d->transmission); }

// f in 1/sr; `layer`: what it reflects along `wi`, and `transmittance` of sheen and coat. Light leaves a sheet on its other side
// as it leaves on this one: `wi` is the mirror image of the direction there. Both sides are covered alike, so that the same is lost on the way.
static vec3 diffuse_eval(const Diffuse* d, __global const float* tables, vec3 wo, vec3 wi, vmask above, vec3 layer, vfloat transmittance) {
    vec3 t = scale(sub(vec3_all(1.0f), layer), transmittance);
    if (lane_any(d->corrected)) t = choose(d->corrected, add(t, mul(t, diffuse_correction(d, tables, wi.z))), t);
    const vec3 f = scale(eon_eval(choose(above, d->color, d->transmission_color), d->roughness, wo, wi), diffuse_share(d, above));
    return choose(d->present, choose(d->covered, mul(f, mul(d->transmitted, t)), f), vec3_all(0.0f));
}

#endif
