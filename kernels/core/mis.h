// Multiple importance sampling (Veach and Guibas 1995).
#ifndef CORE_MIS_H
#define CORE_MIS_H

#include "core/quotient.h"

// The balance heuristic: the weight of a sample that strategy a found with density p_a, where a takes n_a samples, and b takes n_b and
// would have found it with density p_b. Zero: a does not count, or cannot have found it. Exactly 1 where b cannot.
static vfloat mis_weight(vfloat n_a, vfloat p_a, vfloat n_b, vfloat p_b) {
    const vfloat a = n_a * p_a, b = n_b * p_b;
    const vmask counts = a >= 1.17549435e-38f;
    return counts ? quotient(splat(1.0f), splat(1.0f) + quotient(b, counts ? a : splat(1.0f))) : splat(0.0f);
}

#endif
