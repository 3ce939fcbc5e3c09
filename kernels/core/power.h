// Logarithm, exponential and power of exact arithmetic (core/exact.h): polynomials on a reduced range.
#ifndef CORE_POWER_H
#define CORE_POWER_H

#include "core/exact.h"

// log2 x for normal x > 0: the exponent, and twice the inverse hyperbolic tangent of (m − 1)/(m + 1) for m in [√½, √2]. Its series ends
// where terms fall below 2^-31.
static vfloat log2_of(vfloat x) {
    const vuint bits = vfloat_bits(x) - 0x3f3504f3u;             // so that the mantissa begins at √½
    const vint exponent = vint_from_uint(bits) >> 23;
    const vfloat m = vfloat_from_bits((bits & 0x007fffffu) + 0x3f3504f3u);
    const vfloat t = quotient(m - 1.0f, m + 1.0f), t2 = t * t;
    const vfloat series = fma(t2, fma(t2, fma(t2, fma(t2, splat(0.11111111f), splat(0.14285715f)), splat(0.2f)), splat(0.33333334f)), splat(1.0f));
    return fma(t * 2.88539008f, series, vfloat_of(exponent));
}

// 2^x, where x below −126 counts as −126 and above 126 as 126: Taylor's series on [−½, ½], relative error below 2e-7.
static vfloat exp2_of(vfloat x) {
    const vfloat within = bounded(x, -126.0f, 126.0f);
    const vint whole = vint_of(within + 128.5f) - 128;
    const vfloat y = (within - vfloat_of(whole)) * 0.693147181f;
    vfloat p = fma(y, splat(1.98412698e-4f), splat(1.38888889e-3f));
    p = fma(y, fma(y, fma(y, fma(y, p, splat(8.33333333e-3f)), splat(4.16666667e-2f)), splat(0.166666667f)), splat(0.5f));
    p = fma(y, fma(y, p, splat(1.0f)), splat(1.0f));
    return p * vfloat_from_bits(vuint_from_int((whole + 127) << 23));
}

// x^y for x in [0, 1] and y > 0.
static vfloat power(vfloat x, vfloat y) { return x > 1.1754944e-38f ? exp2_of(y * log2_of(x > 1.1754944e-38f ? x : splat(1.0f))) : splat(0.0f); }

#endif
