// Fresnel terms of metals: the share of unpolarised light that a facet reflects.
#ifndef MATERIAL_FRESNEL_H
#define MATERIAL_FRESNEL_H

#include "core/exact.h"

// Of one colour, at `cosine` from the facet's normal, by the complex index of refraction over that of the medium before it. (Lagarde,
// "Memo on Fresnel equations", 2013: real arithmetic alone)
static vfloat fresnel_metal_of(vfloat cosine, vfloat eta, vfloat k) {
    const vfloat cosine2 = cosine * cosine, sine2 = greater(splat(1.0f) - cosine2, splat(0.0f));
    const vfloat eta2 = eta * eta, k2 = k * k;
    const vfloat t0 = eta2 - k2 - sine2;
    const vfloat ab = root(fma(t0, t0, eta2 * k2 * 4.0f));
    const vfloat a = root((ab + t0) * 0.5f);
    const vfloat t1 = ab + cosine2, t2 = a * cosine * 2.0f;
    const vfloat perpendicular = quotient(t1 - t2, t1 + t2);
    const vfloat t3 = fma(cosine2, ab, sine2 * sine2), t4 = t2 * sine2;
    return perpendicular * (splat(1.0f) + quotient(t3 - t4, t3 + t4)) * 0.5f;
}
static vec3 fresnel_metal(vec3 eta, vec3 k, vfloat cosine) {
    return vec3_of(fresnel_metal_of(cosine, eta.x, k.x), fresnel_metal_of(cosine, eta.y, k.y), fresnel_metal_of(cosine, eta.z, k.z));
}

// Schlick's (1 − cosine)^5 (CGF 13(3), 1994).
static vfloat fresnel_grazing(vfloat cosine) {
    const vfloat m = bounded(splat(1.0f) - cosine, 0.0f, 1.0f), m2 = m * m;
    return m2 * m2 * m;
}
static vec3 fresnel_schlick(vec3 f0, vec3 f90, vfloat cosine) { return along(f0, sub(f90, f0), fresnel_grazing(cosine)); }
// Its cosine-weighted average.
static vec3 fresnel_schlick_average(vec3 f0, vec3 f90) { return along(f0, sub(f90, f0), splat(1.0f / 21.0f)); }

// The cosine-weighted average of what a smooth boundary to an index `ior` ≥ 1 times as large reflects: a fit (Kulla & Conti, SIGGRAPH
// course 2017).
static vfloat fresnel_dielectric_average(vfloat ior) { return quotient(ior - 1.0f, fma(ior, splat(1.00071f), splat(4.08567f))); }

#endif
