// Exact arithmetic: the mathematics whose built-ins drivers round differently, made of + − × ÷ sqrt fma and integers only, all of
// which give the same bits everywhere. With LANES lanes; `vec3` is a vector of three such numbers.
#ifndef CORE_EXACT_H
#define CORE_EXACT_H

#include "core/quotient.h"

#define PI 3.14159265358979f
#define INV_PI 0.318309886183791f
#define EPSILON 5.9604645e-8f          // 2^-24: the relative error of one rounding
#define FAR 3.0e38f                    // further than any hit, and finite: infinity times zero is not a number
#define NEVER 3.4e38f                  // further than FAR: where a ray enters a box that it does not enter

typedef struct {
    vfloat x, y, z;
} vec3;

static vec3 vec3_of(vfloat x, vfloat y, vfloat z) {
    vec3 v;
    v.x = x, v.y = y, v.z = z;
    return v;
}
static vec3 vec3_all(float s) { return vec3_of(splat(s), splat(s), splat(s)); }
static vec3 vec3_from(float4 v) { return vec3_of(splat(v.x), splat(v.y), splat(v.z)); }
// Three numbers of a row of a table, from a column of types.h on.
static vec3 vec3_row(const vfloat* row, int column) { return vec3_of(row[column], row[column + 1], row[column + 2]); }
static void vec3_row_put(vfloat* row, int column, vec3 v) { row[column] = v.x, row[column + 1] = v.y, row[column + 2] = v.z; }
static vec3 add(vec3 a, vec3 b) { return vec3_of(a.x + b.x, a.y + b.y, a.z + b.z); }
static vec3 sub(vec3 a, vec3 b) { return vec3_of(a.x - b.x, a.y - b.y, a.z - b.z); }
static vec3 mul(vec3 a, vec3 b) { return vec3_of(a.x * b.x, a.y * b.y, a.z * b.z); }
static vec3 scale(vec3 a, vfloat s) { return vec3_of(a.x * s, a.y * s, a.z * s); }
static vec3 negate(vec3 a) { return vec3_of(-a.x, -a.y, -a.z); }
static vec3 choose(vmask m, vec3 yes, vec3 no) {
    return vec3_of(m ? yes.x : no.x, m ? yes.y : no.y, m ? yes.z : no.z);
}
// a + s b
static vec3 along(vec3 a, vec3 b, vfloat s) { return vec3_of(fma(b.x, s, a.x), fma(b.y, s, a.y), fma(b.z, s, a.z)); }

static vfloat inner(vec3 a, vec3 b) { return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z)); }
static vfloat absolute(vfloat x) { return vfloat_from_bits(vfloat_bits(x) & 0x7fffffffu); }
// |magnitude| with the sign of `sign`. Zero counts as positive, and so does what a driver may take for zero: they agree neither
// about its sign nor about numbers below the smallest normal one.
static vfloat with_sign(vfloat magnitude, vfloat sign) {
    const vfloat size = absolute(magnitude);
    return sign <= -1.1754944e-38f ? -size : size;
}
static vfloat bounded(vfloat x, float low, float high) { return lesser(greater(x, splat(low)), splat(high)); }
static vfloat root(vfloat x) { return square_root(greater(x, splat(0.0f))); }

// a b − c d with two roundings' worth of error at most, so with the right sign (Kahan; Jeannerod et al. 2013).
static vfloat difference_of_products(vfloat a, vfloat b, vfloat c, vfloat d) {
    const vfloat cd = c * d;
    return fma(a, b, -cd) + fma(-c, d, cd);
}
static vec3 outer(vec3 a, vec3 b) {
    return vec3_of(difference_of_products(a.y, b.z, a.z, b.y), difference_of_products(a.z, b.x, a.x, b.z),
                   difference_of_products(a.x, b.y, a.y, b.x));
}
static vfloat largest(vec3 a) { return greater(a.x, greater(a.y, a.z)); }
static vfloat largest_size(vec3 a) { return greater(absolute(a.x), greater(absolute(a.y), absolute(a.z))); }
static vfloat magnitude(vec3 a) { return square_root(inner(a, a)); }

// 1/a; of what is not above zero, 1. Drivers do not agree about numbers below the smallest normal one, 2^-126: such an `a` counts as
// zero, and no result is that small.
static vfloat inverse_or_one(vfloat a) {
    return quotient(splat(1.0f), a >= 1.17549435e-38f ? lesser(a, splat(8.5070592e37f)) : splat(1.0f));
}

// Unit vector along a, whose length is neither tiny nor huge; zero stays zero.
static vec3 direction_of(vec3 a) { return scale(a, inverse_or_one(magnitude(a))); }
// The same, where the length is 1 but for roundings: a step of Newton's.
static vec3 direction_again(vec3 a) { return scale(a, fma(inner(a, a), splat(-0.5f), splat(1.5f))); }

// A power of two that brings the vector's largest component to [1, 2), so that neither 1e-30 nor 1e30 is lost; of zero, any.
static vfloat inverse_scale(vec3 a) { return vfloat_from_bits(0x7f000000u - (vfloat_bits(largest_size(a)) & 0x7f800000u)); }
// Unit vector along any a; zero stays zero.
static vec3 unit(vec3 a) { return direction_of(scale(a, inverse_scale(a))); }
// One over the length of any a.
static vfloat inverse_magnitude(vec3 a) {
    const vfloat s = inverse_scale(a);
    return inverse_or_one(magnitude(scale(a, s))) * s;
}

// cos and sin of 2π u, u in [0, 1): quadrant, then minimax polynomials on [−π/4, π/4] (Cody & Waite's reduction is exact here,
// because the argument is a fraction of a turn). Absolute error below 1.2e-7.
static void cos_sin_turn(vfloat u, vfloat* cosine, vfloat* sine) {
    const vint quadrant = vint_of(fma(u, splat(4.0f), splat(0.5f)));
    const vfloat x = fma(vfloat_of(quadrant), splat(-0.25f), u) * 6.28318530717959f;
    const vfloat x2 = x * x;
    const vfloat s = x * fma(x2, fma(x2, fma(x2, splat(-1.9515296e-4f), splat(8.3321609e-3f)), splat(-1.6666655e-1f)), splat(1.0f));
    const vfloat c = fma(x2, fma(x2, fma(x2, fma(x2, splat(2.4433157e-5f), splat(-1.3887316e-3f)), splat(4.1666646e-2f)), splat(-0.5f)),
                         splat(1.0f));
    const vmask swap = (quadrant & 1) != 0;
    const vmask flip_sine = (quadrant & 2) != 0;
    const vmask flip_cosine = ((quadrant + 1) & 2) != 0;
    const vfloat sx = swap ? c : s;
    const vfloat cx = swap ? s : c;
    *sine = flip_sine ? -sx : sx;
    *cosine = flip_cosine ? -cx : cx;
}

// atan2(y, x) as a fraction of a turn, in [0, 1): minimax polynomial for atan on [0, 1], then the octants. Relative error below 2e-7 near
// the positive x axis, absolute error below 6e-8; of a vector shorter than 1e-30 the result is 0.
static vfloat turn_of(vfloat x, vfloat y) {
    const vfloat ax = absolute(x), ay = absolute(y);
    const vfloat far_x = ax < 1.0e-30f ? splat(0.0f) : ax, far_y = ay < 1.0e-30f ? splat(0.0f) : ay;
    const vmask steep = far_y > far_x;
    const vfloat most = greater(far_x, far_y);
    const vfloat q = quotient(lesser(far_x, far_y), most > 0.0f ? most : splat(1.0f)), q2 = q * q;
    vfloat p = fma(q2, splat(4.53578949e-4f), splat(-2.55742297e-3f));
    p = fma(q2, fma(q2, fma(q2, p, splat(6.79460401e-3f)), splat(-1.19434912e-2f)), splat(1.69355907e-2f));
    p = fma(q2, fma(q2, p, splat(-2.26058085e-2f)), splat(3.1819243e-2f));
    p = q * fma(q2, fma(q2, p, splat(-5.30512333e-2f)), splat(1.59154937e-1f));
    const vfloat eighth = steep ? splat(0.25f) - p : p;
    const vfloat half_turn = x <= -1.0e-30f ? splat(0.5f) - eighth : eighth;
    const vfloat turn = y <= -1.0e-30f ? splat(1.0f) - half_turn : half_turn;
    return turn < 1.0f ? turn : splat(0.0f);
}

// e^(−x) of x ≥ 0: a power of two, and the exponential series of the rest, at most ln 2 / 2 in size (Cody and Waite). Relative error below
// 2 units in the last place; 0 from 87 on, before results are no normal numbers.
static vfloat exp_minus(vfloat x) {
    const vfloat most = lesser(x, splat(87.0f));
    const vint halvings = vint_of(fma(most, splat(1.44269504f), splat(0.5f)));
    const vfloat n = vfloat_of(halvings);
    const vfloat r = fma(n, splat(-1.90465421e-9f), fma(n, splat(0.693147182f), -most));
    vfloat series = fma(r, splat(1.98412698e-4f), splat(1.38888889e-3f));
    series = fma(r, series, splat(8.33333333e-3f));
    series = fma(r, series, splat(4.16666667e-2f));
    series = fma(r, series, splat(1.66666667e-1f));
    series = fma(r, series, splat(0.5f));
    series = fma(r, series, splat(1.0f));
    series = fma(r, series, splat(1.0f));
    return x < 87.0f ? series * vfloat_from_bits(vuint_from_int((127 - halvings) << 23)) : splat(0.0f);
}

// −ln of a number in (0, 1], given by 32 random bits, with all their digits: x = (bits + 1) / 2^32. A power of two times m in [√½, √2), and the
// series of the inverse hyperbolic tangent of (m − 1)/(m + 1). Relative error below 3 units in the last place.
static vfloat minus_log_of_bits(vuint bits) {
    const vfloat x = fma(vfloat_of(vint_from_uint(bits >> 8)), splat(5.9604645e-8f), (vfloat_of(vint_from_uint(bits & 255u)) + 1.0f) * 2.3283064e-10f);
    const vuint shifted = vfloat_bits(x) + (0x3f800000u - 0x3f3504f3u);
    const vint power = vint_from_uint(shifted >> 23) - 127;
    const vfloat m = vfloat_from_bits((shifted & 0x007fffffu) + 0x3f3504f3u);
    const vfloat s = quotient(m - 1.0f, m + 1.0f), s2 = s * s;
    vfloat series = fma(s2, splat(0.111111111f), splat(0.142857143f));
    series = fma(s2, fma(s2, series, splat(0.2f)), splat(0.333333333f));
    series = fma(s * s2, series, s) * -2.0f;
    return greater(fma(vfloat_of(power), splat(-0.693147182f), series), splat(0.0f));
}

#endif
