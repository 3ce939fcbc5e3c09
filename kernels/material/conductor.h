// Metals: microfacets that reflect by Fresnel's equations for a complex index of refraction. The light that is reflected more than
// once between facets is added by a second, diffuse lobe (Kulla & Conti, SIGGRAPH course 2017), so that roughness loses no energy.
// Frame: local, z = shading normal on the side of `wo`. Directions point away from the surface. eval: f in 1/sr, without the
// cosine. pdf: per steradian. A smooth metal is a delta: eval and pdf do not apply.
#ifndef MATERIAL_CONDUCTOR_H
#define MATERIAL_CONDUCTOR_H

#include "core/warp.h"
#include "material/ggx.h"

typedef struct {
    vfloat alpha;            // of GGX; 0: smooth
    vec3 eta, k;             // complex index of refraction over that of the medium before it
    vec3 multiple;           // scale of the second lobe: F_ms / (π (1 − E_avg))
    vfloat missing;          // 1 − E(μo): what the first lobe leaves over of light along `wo`; also how often the second is sampled
    __global const float* albedo;
} Conductor;

// Reflected share of unpolarised light that arrives at `cosine` from the normal, of one colour. (Lagarde, "Memo on Fresnel
// equations", 2013: real arithmetic alone)
static vfloat conductor_fresnel_of(vfloat cosine, vfloat eta, vfloat k) {
    const vfloat cosine2 = cosine * cosine, sine2 = greater(splat(1.0f) - cosine2, splat(0.0f));
    const vfloat eta2 = eta * eta, k2 = k * k;
    const vfloat t0 = eta2 - k2 - sine2;
    const vfloat ab = root(fma(t0, t0, eta2 * k2 * 4.0f));
    const vfloat a = root((ab + t0) * 0.5f);
    const vfloat t1 = ab + cosine2, t2 = a * cosine * 2.0f;
    const vfloat perpendicular = (t1 - t2) / (t1 + t2);
    const vfloat t3 = fma(cosine2, ab, sine2 * sine2), t4 = t2 * sine2;
    return perpendicular * (splat(1.0f) + (t3 - t4) / (t3 + t4)) * 0.5f;
}
static vec3 conductor_fresnel(const Conductor* c, vfloat cosine) {
    return vec3_of(conductor_fresnel_of(cosine, c->eta.x, c->k.x), conductor_fresnel_of(cosine, c->eta.y, c->k.y),
                   conductor_fresnel_of(cosine, c->eta.z, c->k.z));
}

static Conductor conductor_at(__global const float* albedo, const vfloat row[16], vec3 wo) {
    Conductor c;
    c.alpha = row[MATERIAL_ROW_ROUGHNESS];
    c.eta = vec3_row(row, MATERIAL_ROW_ETA);
    c.k = vec3_row(row, MATERIAL_ROW_K);
    c.multiple = vec3_row(row, MATERIAL_ROW_MULTIPLE);
    c.albedo = albedo;
    c.missing = splat(1.0f) - ggx_first_albedo(albedo, greater(c.alpha, splat(1.0e-6f)), wo.z);
    return c;
}

static vec3 conductor_eval(const Conductor* c, vec3 wo, vec3 wi, vfloat* pdf) {
    const vmask seen = wi.z > 0.0f;
    const vec3 below = vec3_of(wi.x, wi.y, greater(wi.z, splat(1.0e-7f)));
    const vfloat alpha = greater(c->alpha, splat(1.0e-6f));
    const vec3 m = unit(add(wo, below));

    // Reflected once, then more often
    const vec3 once = scale(conductor_fresnel(c, bounded(inner(wo, m), 0.0f, 1.0f)), ggx_reflection(alpha, wo, below, m));
    const vfloat missing = splat(1.0f) - ggx_first_albedo(c->albedo, alpha, below.z);
    const vec3 f = along(once, c->multiple, c->missing * missing);

    const vfloat first = ggx_reflected_pdf(alpha, wo, m), second = warp_cosine_hemisphere_pdf(wi.z);
    *pdf = seen ? fma(c->missing, second - first, first) : splat(0.0f);
    return choose(seen, f, vec3_all(0.0f));
}

// One of both lobes, the second as often as the first leaves light over.
static vec3 conductor_sample(const Conductor* c, vec3 wo, vfloat u, vfloat v) {
    const vmask diffuse = u < c->missing;
    const vfloat again = (diffuse ? u : u - c->missing) / (diffuse ? c->missing : splat(1.0f) - c->missing);
    const vfloat within = bounded(again, 0.0f, 0.99999994f);
    const vec3 m = ggx_sample(greater(c->alpha, splat(1.0e-6f)), wo, within, v);
    const vec3 mirrored = sub(scale(m, inner(wo, m) * 2.0f), wo);
    return choose(diffuse, warp_cosine_hemisphere(within, v), mirrored);
}

#endif
