// Diffuse reflection, rough or not (material/eon.h), below a layer that reflects by Schlick's Fresnel term and passes on what it does
// not reflect, and below sheen and coat that do the same. Each layer takes its share E(μ) once as light arrives and once as it leaves:
// with T the product of all 1 − E,
//     f = f_diffuse T(μo) T(μi) / T_avg,
// which is reciprocal, and with a white Lambertian surface below nothing is lost (Kelemen & Szirmay-Kalos, Eurographics 2001). All T
// vary alike, so that T_avg is not the product of their averages: what is between comes from their slants (Slant of material/albedo.h).
// EON is no Lambertian surface. It sends back f = (1 + r A Q(μo, μi)) / π, and what comes out of a is a(μo) ∫ f a, which is to be T(μo).
// With a = T (1 + y) / √T_avg that is so where y = x = −r A (QT)(μo) / T_avg, and half of its average less, to first order. To the next,
// y = x + x² − r A (QTx)(μo) / T_avg; there Tx / T_avg counts as x, and its average, x² / 2, as nothing.
#ifndef MATERIAL_LOBE_DIFFUSE_H
#define MATERIAL_LOBE_DIFFUSE_H

#include "material/albedo.h"
#include "material/eon.h"

typedef struct {
    vmask there;
    vec3 color;
    vfloat share;            // of the surface
    vfloat passes;           // of that, the share of light that leaves on the other side
    vec3 passes_color;       // and its colour
    vfloat roughness;        // r of EON
    vmask covered;           // there is such a layer
    vec3 f0, f90;            // of the layer
    vec3 passed;             // T(μo) (1 + y(μo)) / T_avg of all layers
    vec3 bend_b, bend_c, bend;   // of y, but for x²: along Qb, along Qc, and the rest
    vmask bends;
} Diffuse;

// Sheen and coat, or either, above: their averages, as 1 − E, and how they vary, over that.
typedef struct {
    vfloat sheen_passes, coat_passes;
    Slant sheen, coat;
} Covers;

// Times r over alpha of sheen: narrow sheen varies by more than b and c can say, and of what is below up to so much would be gained.
#define DIFFUSE_SHEEN_SLACK 4.0e-6f

static vec3 diffuse_layer(const Diffuse* d, vfloat all, vfloat grazing) { return along(scale(d->f0, all), sub(d->f90, d->f0), all * grazing); }

// y(μ).
static vec3 diffuse_bent(const Diffuse* d, __global const float* tables, vfloat cosine) {
    __global const float* n = tables + ALBEDO_SLANT_NUMBERS;
    vfloat qb = splat(n[11]), qc = splat(n[16]);
    for (int k = 10; k >= 5; --k) qb = fma(qb, cosine, splat(n[k]));
    for (int k = 15; k >= 12; --k) qc = fma(qc, cosine, splat(n[k]));
    const vec3 x = along(along(d->bend, d->bend_b, qb), d->bend_c, qc);
    return add(x, mul(x, x));
}

// One colour's T_avg over the product of the layers' averages; and bends of y.
static vfloat diffuse_alike(Slant layer, const Covers* over, __global const float* tables, vfloat eon, vfloat* bend_b, vfloat* bend_c, vfloat* bend) {
    __global const float* n = tables + ALBEDO_SLANT_NUMBERS;
    const Slant s = over->sheen, c = over->coat;
    const vfloat upper = s.b * c.b, both = s.b + c.b, pairs = fma(layer.b, both, upper);
    const vfloat alike = fma(layer.c, s.c + c.c, fma(s.c, c.c, pairs)) + fma(upper * layer.b, splat(-n[0]), splat(1.0f));
    const vfloat b = fma(pairs, splat(-n[0]), layer.b + both), e = fma(pairs, splat(-n[1]), layer.c + s.c + c.c);
    const vfloat q = quotient(eon, alike);
    *bend_b = q * fma(-q, fma(b, splat(n[2]), e * n[3]), b), *bend_c = q * fma(-q, fma(b, splat(n[3]), e * n[4]), e);
    *bend = quotient(q * fma(b, fma(b, splat(n[2]), e * (n[3] + n[3])), e * e * n[4]), alike * 2.0f);
    return alike;
}

// `all`, `grazing`: E and B / E of the layer along `wo` (material/albedo.h); `kept` is E_avg, `below` what sheen and coat leave.
static void diffuse_cover(Diffuse* d, const Covers* over, __global const float* tables, vfloat alpha, vfloat kept, vfloat all, vfloat grazing,
                          vfloat below, vfloat cosine) {
    const vec3 average = along(scale(d->f0, kept), sub(d->f90, d->f0), albedo_grazing_average(tables, alpha)), one = vec3_all(1.0f);
    const vec3 passes = sub(one, average), inverse = vec3_of(inverse_or_one(passes.x), inverse_or_one(passes.y), inverse_or_one(passes.z));
    const Slant e = albedo_slant(tables, 0u, alpha), g = albedo_slant(tables, 1u, alpha);
    const vec3 b = mul(along(scale(d->f0, e.b), sub(d->f90, d->f0), g.b), inverse), c = mul(along(scale(d->f0, e.c), sub(d->f90, d->f0), g.c), inverse);
    const vfloat eon = quotient(d->roughness, fma(d->roughness, splat(EON_C1), splat(1.0f)));
    const Slant x = {b.x, c.x}, y = {b.y, c.y}, z = {b.z, c.z};
    vec3 alike;
    alike.x = diffuse_alike(x, over, tables, eon, &d->bend_b.x, &d->bend_c.x, &d->bend.x);
    alike.y = diffuse_alike(y, over, tables, eon, &d->bend_b.y, &d->bend_c.y, &d->bend.y);
    alike.z = diffuse_alike(z, over, tables, eon, &d->bend_b.z, &d->bend_c.z, &d->bend.z);
    d->bends = d->covered & (d->roughness > 0.0f);
    const vfloat upper = quotient(below, over->sheen_passes * over->coat_passes);
    vec3 passed = scale(mul(sub(one, diffuse_layer(d, all, grazing)), inverse), upper);
    passed = vec3_of(quotient(passed.x, alike.x), quotient(passed.y, alike.y), quotient(passed.z, alike.z));
    if (lane_any(d->bends)) passed = choose(d->bends, add(passed, mul(passed, diffuse_bent(d, tables, cosine))), passed);
    d->passed = choose(d->covered, passed, one);
}

// The share of the surface whose light leaves on this side (`above`) or the other.
static vfloat diffuse_share(const Diffuse* d, vmask above) { return d->share * (above ? splat(1.0f) - d->passes : d->passes); }

// f in 1/sr; `all`, `grazing` of the layer along `wi`, and `left` by sheen and coat. Light leaves a sheet on its other side as it leaves on
// this one: `wi` is the mirror image of the direction there. Both sides are covered alike, so that the same is lost on the way.
static vec3 diffuse_eval(const Diffuse* d, __global const float* tables, vec3 wo, vec3 wi, vmask above, vfloat all, vfloat grazing, vfloat left) {
    vec3 below = scale(sub(vec3_all(1.0f), diffuse_layer(d, all, grazing)), left);
    if (lane_any(d->bends)) below = choose(d->bends, add(below, mul(below, diffuse_bent(d, tables, wi.z))), below);
    const vec3 f = scale(eon_eval(choose(above, d->color, d->passes_color), d->roughness, wo, wi), diffuse_share(d, above));
    return choose(d->there, choose(d->covered, mul(f, mul(d->passed, below)), f), vec3_all(0.0f));
}

#endif
