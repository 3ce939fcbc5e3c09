// Sheen of cloth: microfacets that stand upright, "Charlie" (Estevez & Kulla, "Production friendly microfacet sheen BRDF", 2017), as glTF's
// KHR_materials_sheen names it. A scale for each roughness keeps the smoothest from reflecting more than arrives.
// Frame: local, z = shading normal on the side of `wo`. eval: f in 1/sr, without the cosine. It is sampled evenly over the hemisphere.
#ifndef MATERIAL_LOBE_SHEEN_H
#define MATERIAL_LOBE_SHEEN_H

#include "core/power.h"
#include "material/albedo.h"

typedef struct {
    vmask present;
    vec3 color;
    vfloat most;             // the largest component of the color
    vfloat alpha, scale;
    vfloat hidden;           // 1 + Λ(μo)
} Sheen;

#define SHEEN_PDF 0.159154943091895f     // of the hemisphere

// 1 + Λ, from the paper's fit.
static vfloat sheen_hidden(const Sheen* s, vfloat cosine) {
    const vfloat b = splat(1.0f) - s->alpha, w = b * b;
    const vfloat p = fma(w, splat(25.3245f - 21.5473f), splat(21.5473f)), q = fma(w, splat(3.32435f - 3.82987f), splat(3.82987f));
    const vfloat r = fma(w, splat(0.16801f - 0.19823f), splat(0.19823f)), t = fma(w, splat(1.97760f - 1.27393f), splat(-1.97760f));
    const vfloat e = fma(w, splat(4.32054f - 4.85967f), splat(-4.32054f));
    const vmask steep = cosine < 0.5f;
    const vfloat x = steep ? cosine : splat(1.0f) - cosine;
    const vfloat of = fma(t, x, e) + quotient(p, fma(q, power(x, r), splat(1.0f)));
    const vfloat half_ = fma(t, splat(0.5f), e) + quotient(p, fma(q, power(splat(0.5f), r), splat(1.0f)));
    const vfloat logarithm = steep ? of : half_ * 2.0f - of;
    return splat(1.0f) + exp2_of(logarithm * 1.44269504f);
}

// The share of light along a direction that it reflects, for a white one.
static vfloat sheen_albedo(const Sheen* s, __global const float* tables, vfloat cosine) {
    const vfloat x = root(cosine) * (float)(SHEEN_COLUMNS - 1u);
    return albedo_at(tables, splat_uint(ALBEDO_SHEEN), SHEEN_ROWS, SHEEN_COLUMNS - 1u, SHEEN_COLUMNS - 1u, root(s->alpha) * (float)(SHEEN_ROWS - 1u), x);
}

static vec3 sheen_eval(const Sheen* s, vec3 wo, vec3 wi) {
    const vec3 h = add(wo, wi);
    const vfloat across2 = fma(h.x, h.x, h.y * h.y);
    const vfloat sine = root(quotient(across2, fma(h.z, h.z, across2))), inverse = quotient(splat(1.0f), s->alpha);
    const vfloat density = (inverse + 2.0f) * power(sine, inverse) * (0.5f * INV_PI);
    const vfloat f = quotient(density * s->scale, (s->hidden + sheen_hidden(s, wi.z) - 1.0f) * wo.z * wi.z * 4.0f);
    return choose(s->present, scale(s->color, f), vec3_all(0.0f));
}

#endif
