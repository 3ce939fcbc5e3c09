// Perfect reflection. Frame: local, z = shading normal on the side of `wo`. A delta distribution: eval and pdf are zero, sample
// returns the weight that the radiance along `wi` gets.
#ifndef MATERIAL_MIRROR_H
#define MATERIAL_MIRROR_H

#include "core/exact.h"

static vec3 mirror_sample(vec3 color, vec3 wo, vec3* wi) {
    *wi = vec3_of(-wo.x, -wo.y, wo.z);
    return color;
}

#endif
