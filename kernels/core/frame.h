// An orthonormal frame around a unit normal: local z is the normal.
#ifndef CORE_FRAME_H
#define CORE_FRAME_H

#include "core/exact.h"

typedef struct {
    vec3 tangent, bitangent, normal;
} Frame;

// Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1) 2017: no branch, no singular direction.
static Frame frame_around(vec3 n) {
    const vfloat sign = with_sign(splat(1.0f), n.z);
    const vfloat a = quotient(splat(-1.0f), sign + n.z);
    const vfloat b = n.x * n.y * a;
    Frame f;
    f.tangent = vec3_of(splat(1.0f) + sign * n.x * n.x * a, sign * b, -sign * n.x);
    f.bitangent = vec3_of(b, sign + n.y * n.y * a, -n.y);
    f.normal = n;
    return f;
}
static vec3 frame_to_world(Frame f, vec3 v) { return along(along(scale(f.normal, v.z), f.bitangent, v.y), f.tangent, v.x); }
static vec3 frame_to_local(Frame f, vec3 v) { return vec3_of(inner(v, f.tangent), inner(v, f.bitangent), inner(v, f.normal)); }

#endif
