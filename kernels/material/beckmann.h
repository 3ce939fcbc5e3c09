// Beckmann's distribution of facet normals (Beckmann & Spizzichino 1963; Walter et al., EGSR 2007), which Mitsuba's rough surfaces have
// unless told otherwise. Facets are chosen by GGX of the same alpha all the same: its tails are the longer ones, so that the ratio of both
// is bounded.
// Frame: local, z = shading normal on the side of `wo`. Directions point away from the surface.
#ifndef MATERIAL_BECKMANN_H
#define MATERIAL_BECKMANN_H

#include "material/ggx.h"

// The density of facet normals D, per steradian.
static vfloat beckmann_distribution(Alpha a, vec3 wm) {
    const vfloat across_x = quotient(splat(1.0f), a.x), across_y = quotient(splat(1.0f), a.y);
    const vfloat x = wm.x * across_x, y = wm.y * across_y, upright = quotient(splat(1.0f), greater(wm.z * wm.z, splat(1.0e-12f)));
    return exp_minus(fma(x, x, y * y) * upright) * splat(INV_PI) * across_x * across_y * upright * upright;
}

// Smith's Λ, by the fit of Walter et al. (eq. 18), within 0.4 %.
static vfloat beckmann_lambda(Alpha a, vec3 w) {
    const vfloat x = a.x * w.x, y = a.y * w.y, across = root(fma(x, x, y * y));
    // The cosine over alpha times the sine
    const vfloat upright = quotient(absolute(w.z), greater(across, splat(1.0e-12f))), bent = lesser(upright, splat(1.6f));
    const vfloat hidden = fma(bent, fma(bent, splat(0.396f), splat(-1.259f)), splat(1.0f));
    return upright < 1.6f ? quotient(hidden, greater(bent * fma(bent, splat(2.181f), splat(3.535f)), splat(1.0e-7f))) : splat(0.0f);
}

// What such facets scatter from `wo` to `wi` at first, over what those of GGX do. `wm`: the facet normal between both.
static vfloat beckmann_over_ggx(Alpha a, vec3 wo, vec3 wi, vec3 wm) {
    const vfloat one = splat(1.0f), seen = quotient(one + ggx_lambda(a, wo) + ggx_lambda(a, wi), one + beckmann_lambda(a, wo) + beckmann_lambda(a, wi));
    return quotient(beckmann_distribution(a, wm), ggx_distribution(a, wm)) * seen;
}

#endif
