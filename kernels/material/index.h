// What a change of the index of refraction does to light. `eta`: index on the side that light comes from, over that of the side where it is
// seen from: beyond over here, along a path from the camera.
//
// Radiance over the squared index is what stays the same along a ray (PBR 4ed, 9.5.2): so in a denser medium, in equilibrium, there is
// eta² times as much. Flux does not change.
#ifndef MATERIAL_INDEX_H
#define MATERIAL_INDEX_H

#include "core/exact.h"

// What radiance from beyond is multiplied by.
static vfloat index_radiance(vfloat eta) {
    const vfloat inverse = quotient(splat(1.0f), eta);
    return inverse * inverse;
}

// And what makes flux of radiance that was.
static vfloat index_flux(vfloat eta) { return eta * eta; }

// Of diffuse light, the share that can pass: from a denser medium only what meets no total reflection.
static vfloat index_passes(vfloat eta) { return lesser(index_flux(eta), splat(1.0f)); }

#endif
