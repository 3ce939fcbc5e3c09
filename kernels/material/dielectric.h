// A smooth boundary between two transparent media: reflection and refraction by Fresnel's equations for unpolarised light.
// Frame: local, z = shading normal on the side of `wo`. Delta distributions: eval and pdf are zero, sample picks one of the two by
// its share of the light and returns the weight that the radiance along `wi` gets.
#ifndef MATERIAL_DIELECTRIC_H
#define MATERIAL_DIELECTRIC_H

#include "material/index.h"

// Reflected share of light arriving at `cosine` from the normal; `eta` is the index beyond the surface over the index on this
// side. `refracted` is the cosine beyond, 0 under total internal reflection. (PBR 4ed, 9.3.5)
static vfloat dielectric_fresnel(vfloat cosine, vfloat eta, vfloat* refracted) {
    const vfloat sine2 = quotient(greater(splat(1.0f) - cosine * cosine, splat(0.0f)), eta * eta);
    const vmask total = sine2 >= 1.0f;
    const vfloat beyond = root(splat(1.0f) - sine2);
    const vfloat parallel = quotient(eta * cosine - beyond, eta * cosine + beyond);
    const vfloat perpendicular = quotient(cosine - eta * beyond, cosine + eta * beyond);
    *refracted = total ? splat(0.0f) : beyond;
    return total ? splat(1.0f) : (parallel * parallel + perpendicular * perpendicular) * 0.5f;
}

// `eta` as above. Radiance that crosses is scaled by 1/eta² (it is spread over another solid angle).
static vec3 dielectric_sample(vec3 color, vfloat eta, vec3 wo, vfloat u, vec3* wi) {
    vfloat beyond;
    const vfloat reflected = dielectric_fresnel(wo.z, eta, &beyond);
    const vmask reflect = u < reflected;
    const vfloat inverse = quotient(splat(1.0f), eta);
    *wi = vec3_of(reflect ? -wo.x : -wo.x * inverse, reflect ? -wo.y : -wo.y * inverse, reflect ? wo.z : -beyond);
    return scale(color, reflect ? splat(1.0f) : index_radiance(eta));
}

#endif
