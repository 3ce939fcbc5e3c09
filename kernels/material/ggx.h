// Rough surfaces of microfacets whose normals have the distribution GGX (Trowbridge & Reitz 1975; Walter et al. 2007), with Smith's
// masking and shadowing (Heitz, JCGT 3(2), 2014). `alpha` is above zero.
// Frame: local, z = shading normal on the side of `wo`. Directions point away from the surface.
#ifndef MATERIAL_GGX_H
#define MATERIAL_GGX_H

#include "core/exact.h"
#include "types.h"

// The density of facet normals D, per steradian, of facets that stand upright. From the sine, which keeps its digits where alpha is
// small.
static vfloat ggx_distribution(vfloat alpha, vec3 m) {
    const vfloat inverse = splat(1.0f) / alpha;
    const vfloat x = m.x * inverse, y = m.y * inverse;
    const vfloat t = fma(x, x, fma(y, y, m.z * m.z));
    return splat(INV_PI) * inverse * inverse / (t * t);
}

// Smith's Λ: 1/(1 + Λ) is the share of a facet's area that is seen along `w`.
static vfloat ggx_lambda(vfloat alpha, vec3 w) {
    const vfloat cosine = greater(w.z, splat(1.0e-7f));
    const vfloat slope2 = alpha * alpha * fma(w.x, w.x, w.y * w.y) / (cosine * cosine);
    // (√(1 + s) − 1) / 2 without cancellation
    return slope2 * 0.5f / (splat(1.0f) + root(splat(1.0f) + slope2));
}

// A facet normal as seen along `wo`: a point of a spherical cap (Dupuy & Benyoub, CGF 42(8), 2023).
static vec3 ggx_sample(vfloat alpha, vec3 wo, vfloat u, vfloat v) {
    const vec3 stretched = unit(vec3_of(alpha * wo.x, alpha * wo.y, wo.z));
    const vfloat z = fma(splat(1.0f) - v, splat(1.0f) + stretched.z, -stretched.z);
    const vfloat r = root(splat(1.0f) - z * z);
    vfloat c, s;
    cos_sin_turn(u, &c, &s);
    const vec3 h = add(vec3_of(r * c, r * s, z), stretched);
    return unit(vec3_of(alpha * h.x, alpha * h.y, greater(h.z, splat(0.0f))));
}

// Density of the direction that `wo` is reflected to at such a facet, per steradian.
static vfloat ggx_reflected_pdf(vfloat alpha, vec3 wo, vec3 m) {
    return ggx_distribution(alpha, m) / ((splat(1.0f) + ggx_lambda(alpha, wo)) * wo.z * 4.0f);
}

// Reflection by perfect mirrors as facets, once: f in 1/sr, without the cosine.
static vfloat ggx_reflection(vfloat alpha, vec3 wo, vec3 wi, vec3 m) {
    const vfloat seen = splat(1.0f) / (splat(1.0f) + ggx_lambda(alpha, wo) + ggx_lambda(alpha, wi));
    return ggx_distribution(alpha, m) * seen / (wo.z * wi.z * 4.0f);
}

// The share of light along a direction that such a surface reflects at first, by bilinear interpolation. Rows: √alpha; columns:
// √(μ (1 + α) / (μ + α)), because it is a function of the slope over alpha where both are small.
static vfloat ggx_first_albedo(__global const float* table, vfloat alpha, vfloat cosine) {
    const float last = (float)(GGX_TABLE_SIZE - 1u);
    const vfloat y = root(alpha) * last, x = root(cosine * (splat(1.0f) + alpha) / (cosine + alpha)) * last;
    const vint row = vint_of(lesser(y, splat(last - 1.0f))), column = vint_of(lesser(x, splat(last - 1.0f)));
    const vfloat down = y - vfloat_of(row), right = x - vfloat_of(column);
    const vuint at = vuint_from_int(row) * GGX_TABLE_SIZE + vuint_from_int(column);
    const vfloat a = lane_gather(table, at), b = lane_gather(table, at + 1u);
    const vfloat c = lane_gather(table, at + GGX_TABLE_SIZE), d = lane_gather(table, at + GGX_TABLE_SIZE + 1u);
    const vfloat upper = fma(right, b - a, a), lower = fma(right, d - c, c);
    return fma(down, lower - upper, upper);
}

#endif
