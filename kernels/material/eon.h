// Rough diffuse reflection: energy-preserving Oren–Nayar (EON: Portsmouth, Kutz & Hill, JCGT 14(1), 2025). The light that scatters
// more than once between the facets is added back, so a white surface stays white.
// Frame: local, z = shading normal on the side of `wo`. Directions point away from the surface. eval: f in 1/sr, without the
// cosine. It is sampled as Lambert's reflection is, and at grazing angles in part evenly over the hemisphere.
#ifndef MATERIAL_EON_H
#define MATERIAL_EON_H

#include "core/exact.h"

#define EON_C1 0.28779341f             // 1/2 − 2/(3π)
#define EON_C2 0.07248821f             // 2/3 − 28/(15π)

// What single scattering loses of light along a direction, but for a factor r / (1 + EON_C1 r): their fit of the albedo.
static vfloat eon_missing(vfloat cosine) {
    const vfloat m = splat(1.0f) - cosine;
    const vfloat g = m * fma(m, fma(m, fma(m, splat(0.0714429953f), splat(-0.332181442f)), splat(0.491881867f)), splat(0.0571085289f));
    return greater(splat(EON_C1) - g, splat(0.0f));
}

// The colour that light has after it was scattered more than once.
static vfloat eon_multiple(vfloat color, vfloat average) {
    return quotient(color * color * average, splat(1.0f) - color * (splat(1.0f) - average));
}

// `roughness` is r, from 0 (Lambert) to 1.
static vec3 eon_eval(vec3 color, vfloat roughness, vec3 wo, vec3 wi) {
    const vfloat a = quotient(splat(1.0f), fma(roughness, splat(EON_C1), splat(1.0f)));

    // Scattered once: facets that face the light are seen more of from the light's own side
    const vfloat s = fma(wo.x, wi.x, wo.y * wi.y);
    const vfloat t = s > 0.0f ? greater(wo.z, wi.z) : splat(1.0f);
    const vfloat single = a * fma(roughness, quotient(s, t), splat(1.0f));

    // Scattered more often
    const vfloat average = a * fma(roughness, splat(EON_C2), splat(1.0f));
    const vfloat lost = roughness * a * eon_missing(wo.z) * eon_missing(wi.z) * (1.0f / (EON_C1 - EON_C2));
    const vec3 multiple = vec3_of(eon_multiple(color.x, average), eon_multiple(color.y, average), eon_multiple(color.z, average));

    const vec3 f = scale(along(scale(color, single), multiple, lost), splat(INV_PI));
    return choose((wi.z > 0.0f) & (wo.z > 0.0f), f, vec3_all(0.0f));
}

#endif
