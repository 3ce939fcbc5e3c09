// What interpolated normals do to flux, which comes from the lights (Veach 1997, 5.3.2).
#ifndef MATERIAL_TURNING_H
#define MATERIAL_TURNING_H

#include "material/bsdf.h"

// How much a surface's interpolated normal changes what a photon brings, for one of its directions (Veach 1997, 5.3.2): nothing where it
// is the surface's own, however grazing the direction.
static vfloat bsdf_shaded(const Bsdf* bsdf, vec3 direction) {
    const vfloat shading = absolute(inner(direction, bsdf->frame.normal)), side = absolute(inner(direction, bsdf->side));
    return quotient(greater(shading, splat(1.0e-6f)), greater(side, splat(1.0e-6f)));
}

// The factor of a direction that comes in and one that goes out. Where glass has either on another side by its shading normal than by its
// geometry (bsdf_other_side), none is known: the flux stays, so that it cannot grow from wall to wall.
static vfloat bsdf_turned(const Bsdf* bsdf, vec3 direction, vec3 next) {
    const vfloat in = bsdf_shaded(bsdf, direction), out = bsdf_shaded(bsdf, next);
    const vmask in_other = (inner(direction, bsdf->side) < 0.0f) != (inner(direction, bsdf->frame.normal) < 0.0f);
    const vmask out_other = (inner(next, bsdf->side) > 0.0f) != (inner(next, bsdf->frame.normal) > 0.0f);
    return bsdf_is_clear(bsdf) & (in_other | out_other) ? splat(1.0f) : quotient(in, greater(out, splat(1.0e-6f)));
}

#endif
