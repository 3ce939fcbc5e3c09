// Shading normals that no view is mirrored into the surface by.
#ifndef CORE_BENT_H
#define CORE_BENT_H

#include "core/exact.h"

#define BENT_LIMIT 0.01f     // of the cosine of the mirrored view, where that of the view is not nearly as small

// A shading normal may turn so far that the mirrored view points into the surface, which shows as black rims. Of all normals between
// it and the geometry's it is then the last for which the mirrored view stays above the surface.
//
// `side` and `view` are unit vectors on one side of the surface. With β the angle from `side` to the normal, p = view · side and
// q = view · s, s being the unit vector across `side` in the normal's plane, the mirrored view is p cos 2β + q sin 2β above the surface.
// That is A cos(2β − δ), A² = p² + q²; the limit ε is reached where the mirrored view is ε side + √(A² − ε²) s in that plane, and the
// normal half-way between it and the view.
static vec3 bent_normal(vec3 normal, vec3 side, vec3 view) {
    const vfloat cosine = inner(normal, side), p = inner(view, side);
    const vec3 level = sub(normal, scale(side, cosine));
    const vec3 s = unit(level);
    const vfloat sine = inner(normal, s), q = inner(view, s);
    const vfloat limit = lesser(p * 0.9f, splat(BENT_LIMIT));
    const vfloat above = fma(p, fma(cosine, cosine * 2.0f, splat(-1.0f)), q * sine * cosine * 2.0f);
    const vmask sound = (above >= limit) & (cosine > 0.0f);
    const vfloat above2 = (p - limit) * (p + limit), far = root(fma(q, q, above2));
    // q + far, without the loss of digits where q is negative
    const vfloat step = q < 0.0f ? above2 * inverse_or_one(far - q) : q + far;
    const vec3 bent = along(scale(side, p + limit), s, step);
    return choose(sound | !(p > 0.0f), normal, unit(bent));
}

// Where bent_normal may have anything to do: everywhere but where the mirrored view is above the limit by more than roundings.
static vmask bent_needed(vec3 normal, vec3 side, vec3 view) {
    const vfloat cosine = inner(normal, side);
    const vfloat above = fma(inner(view, normal) * 2.0f, cosine, -inner(view, side));
    return !((above > BENT_LIMIT + 1.0e-4f) & (cosine > 1.0e-4f));
}

#endif
