// Ideal diffuse reflection (Lambert), on both sides of the surface.
// Frame: local, z = shading normal on the side of `wo`. Directions point away from the surface. eval: f in 1/sr, without the
// cosine. pdf: per steradian. Zero: `wi` below the surface.
#ifndef MATERIAL_LAMBERT_H
#define MATERIAL_LAMBERT_H

#include "core/warp.h"

static vec3 lambert_eval(vec3 color, vec3 wi) { return scale(color, wi.z > 0.0f ? splat(INV_PI) : splat(0.0f)); }
static vfloat lambert_pdf(vec3 wi) { return warp_cosine_hemisphere_pdf(wi.z); }
// f cosθ / pdf is the colour itself.
static vec3 lambert_sample(vec3 color, vfloat u, vfloat v, vec3* wi) {
    *wi = warp_cosine_hemisphere(u, v);
    return color;
}

#endif
