// Invariants of the structs that the steps of a path hand on. A debug build (-D INVARIANTS, a bit for each kind below that is checked) looks at
// each of them in `X_violates` of the struct's own file, and a path that violates one delivers no radiance but NaN, which the film counts. So one
// number says which pixels, and a build for each kind says what (tests/statistics/test_invariants.py). Other builds have nothing of this.
#ifndef CORE_INVARIANT_H
#define CORE_INVARIANT_H

#ifdef INVARIANTS

#include "core/exact.h"

#define INVARIANT_RAY 1u
#define INVARIANT_SURFACE 2u
#define INVARIANT_BSDF 4u
#define INVARIANT_CLOSURE 8u
#define INVARIANT_BSDF_SAMPLE 16u
#define INVARIANT_LIGHT_SAMPLE 32u
#define INVARIANT_PATH 64u

// Of lengths and sums that are to be 1, and the largest number that counts as finite. Tests set others, to show that violations are found.
#ifndef INVARIANT_SLACK
#define INVARIANT_SLACK 1.0e-5f
#endif
#ifndef INVARIANT_MOST
#define INVARIANT_MOST FAR
#endif
#define INVARIANT_NAN vfloat_from_bits((vuint)(0x7fc00000u))

// Written so that NaN breaks them.
static vmask invariant_near(vfloat x, float wanted) { return absolute(x - wanted) <= INVARIANT_SLACK; }
static vmask invariant_unit(vec3 v) { return absolute(inner(v, v) - 1.0f) <= INVARIANT_SLACK; }
static vmask invariant_positive(vfloat x) { return (x >= 0.0f) & (x <= INVARIANT_MOST); }
static vmask invariant_positive3(vec3 v) { return invariant_positive(v.x) & invariant_positive(v.y) & invariant_positive(v.z); }
static vmask invariant_finite3(vec3 v) { return (absolute(v.x) <= INVARIANT_MOST) & (absolute(v.y) <= INVARIANT_MOST) & (absolute(v.z) <= INVARIANT_MOST); }

// Of a path: a struct of this kind violates its invariants.
#define INVARIANT(path, kind, violated) \
    if (INVARIANTS & (kind)) (path)->broken = (path)->broken | (violated)

#else

#define INVARIANT(path, kind, violated)

#endif

#endif
