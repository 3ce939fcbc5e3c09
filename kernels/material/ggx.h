// Rough surfaces of microfacets whose normals have the distribution GGX (Trowbridge & Reitz 1975; Walter et al. 2007), with Smith's
// masking and shadowing (Heitz, JCGT 3(2), 2014). `a` has alpha along x and along y, both above zero.
// Frame: local, z = shading normal on the side of `wo`. Directions point away from the surface; `wm` is the normal of a facet.
#ifndef MATERIAL_GGX_H
#define MATERIAL_GGX_H

#include "core/exact.h"

typedef struct {
    vfloat x, y;
} Alpha;

// The density of facet normals D, per steradian, of facets that stand upright. From the sine, which keeps its digits where alpha is
// small.
static vfloat ggx_distribution(Alpha a, vec3 wm) {
    const vfloat across_x = quotient(splat(1.0f), a.x), across_y = quotient(splat(1.0f), a.y);
    const vfloat x = wm.x * across_x, y = wm.y * across_y;
    const vfloat t = fma(x, x, fma(y, y, wm.z * wm.z));
    return quotient(splat(INV_PI) * across_x * across_y, t * t);
}

// Smith's Λ: 1/(1 + Λ) is the share of a facet's area that is seen along `w`.
static vfloat ggx_lambda(Alpha a, vec3 w) {
    const vfloat cosine = greater(absolute(w.z), splat(1.0e-7f));
    const vfloat x = a.x * w.x, y = a.y * w.y;
    const vfloat slope2 = quotient(fma(x, x, y * y), cosine * cosine);
    // (√(1 + s) − 1) / 2 without cancellation
    return quotient(slope2 * 0.5f, splat(1.0f) + root(splat(1.0f) + slope2));
}

// A facet normal as seen along `wo`: a point of a spherical cap (Dupuy & Benyoub, CGF 42(8), 2023).
static vec3 ggx_sample(Alpha a, vec3 wo, vfloat u, vfloat v) {
    const vec3 stretched = unit(vec3_of(a.x * wo.x, a.y * wo.y, wo.z));
    const vfloat z = fma(splat(1.0f) - v, splat(1.0f) + stretched.z, -stretched.z);
    const vfloat r = root(splat(1.0f) - z * z);
    vfloat c, s;
    cos_sin_turn(u, &c, &s);
    const vec3 h = add(vec3_of(r * c, r * s, z), stretched);
    return unit(vec3_of(a.x * h.x, a.y * h.y, greater(h.z, splat(0.0f))));
}

// Density of such a facet normal, per steradian, but for the cosine between it and `wo`.
static vfloat ggx_visible(Alpha a, vec3 wo, vec3 wm) { return quotient(ggx_distribution(a, wm), (splat(1.0f) + ggx_lambda(a, wo)) * wo.z); }

// Density of the direction that `wo` is reflected to at such a facet, per steradian.
static vfloat ggx_reflected_pdf(Alpha a, vec3 wo, vec3 wm) { return ggx_visible(a, wo, wm) * 0.25f; }

// The facet normal between two directions. Rounded directions are no unit vectors: their lengths are off by 2^-24, and beside a small sum
// of both z that turns the normal by a part of what smooth facets stand apart. But lengths follow from z: with o and i the parts along the
// surface, (o + i) · (o − i) is i.z² − o.z². Where o and i are less than 1 apart, the facet is far from upright. `alpha`: the smoothest.
static vec3 ggx_between(vfloat alpha, vec3 wo, vec3 wi) {
    vec3 wm = add(wo, wi);
    const vfloat x = wo.x - wi.x, y = wo.y - wi.y;
    const vfloat missing = quotient(fma(wi.z - wo.z, wm.z, -fma(wm.x, x, wm.y * y)), greater(fma(x, x, y * y), splat(1.0f)));
    const vfloat part = alpha * wm.z < 1.0e-4f ? missing : splat(0.0f);
    wm.x = fma(part, x, wm.x);
    wm.y = fma(part, y, wm.y);
    return unit(wm);
}

// Single reflection by facets that are perfect mirrors: D(ωm) G2(ωo, ωi) / (4 μo μi) in 1/sr, G2 = 1 / (1 + Λ(ωo) + Λ(ωi)). The density
// of `wi` is D(ωm) G1(ωo) / (4 μo), G1 = 1 / (1 + Λ(ωo)).
static vfloat ggx_reflection(Alpha a, vec3 wo, vec3 wi, vec3 wm, vfloat* pdf) {
    const vfloat d = ggx_distribution(a, wm), lambda_o = splat(1.0f) + ggx_lambda(a, wo);
    const vfloat quarter = quotient(d, wo.z * 4.0f);
    *pdf = quotient(quarter, lambda_o);
    return quotient(quarter, (lambda_o + ggx_lambda(a, wi)) * wi.z);
}

#endif
