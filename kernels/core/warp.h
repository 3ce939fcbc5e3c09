// Warps: from the unit square to where light goes, each with its density beside it. Densities are per unit of the measure named.
#ifndef CORE_WARP_H
#define CORE_WARP_H

#include "core/exact.h"
#include "core/power.h"

// Unit disk, uniform by area; concentric map (Shirley & Chiu 1997) in the form without divisions by zero.
static void warp_disk(vfloat u, vfloat v, vfloat* x, vfloat* y) {
    const vfloat a = fma(u, splat(2.0f), splat(-1.0f)), b = fma(v, splat(2.0f), splat(-1.0f));
    const vmask wide = absolute(a) > absolute(b);
    const vfloat radius = wide ? a : b;
    const vfloat below = radius == 0.0f ? splat(1.0f) : radius;
    const vfloat ratio = quotient(wide ? b : a, below);                  // in [−1, 1]: eighths of a turn
    const vfloat eighth = wide ? ratio * 0.125f : fma(ratio, splat(-0.125f), splat(0.25f));
    const vfloat turn = eighth < 0.0f ? eighth + 1.0f : eighth;
    vfloat c, s;
    cos_sin_turn(turn, &c, &s);
    *x = radius * c;
    *y = radius * s;
}

// Upper hemisphere around z, density cosθ/π per steradian (Malley). At its rim 1 - x² - y² rounds to zero once in some ten million
// samples; the smallest difference that is not zero keeps the direction above the surface, whatever frame it is taken to.
static vec3 warp_cosine_hemisphere(vfloat u, vfloat v) {
    vfloat x, y;
    warp_disk(u, v, &x, &y);
    return vec3_of(x, y, root(greater(splat(1.0f) - x * x - y * y, splat(5.9604645e-8f))));
}
static vfloat warp_cosine_hemisphere_pdf(vfloat cosine) { return greater(cosine, splat(0.0f)) * INV_PI; }

// Upper hemisphere around z, density cosθ / (cos²θ + width²) over its integral, π ln(1 + 1/width²): dense within about `width` of the
// horizon. `octaves` = log2(1 + 1/width²).
static vec3 warp_low_hemisphere(vfloat u, vfloat v, vfloat width2, vfloat octaves) {
    const vfloat z2 = bounded(width2 * (exp2_of(v * octaves) - 1.0f), 1.0e-14f, 1.0f), r = root(splat(1.0f) - z2);
    vfloat c, s;
    cos_sin_turn(u, &c, &s);
    return vec3_of(r * c, r * s, root(z2));
}
static vfloat warp_low_hemisphere_pdf(vfloat cosine, vfloat width2, vfloat octaves) {
    return quotient(greater(cosine, splat(0.0f)) * (INV_PI * 1.44269504f), fma(cosine, cosine, width2) * octaves);
}

// Whole sphere, density 1/(4π) per steradian.
static vec3 warp_sphere(vfloat u, vfloat v) {
    const vfloat z = fma(u, splat(-2.0f), splat(1.0f));
    const vfloat r = root(splat(1.0f) - z * z);
    vfloat c, s;
    cos_sin_turn(v, &c, &s);
    return vec3_of(r * c, r * s, z);
}
#define WARP_SPHERE_PDF 0.0795774715459477f

// Cone around z, uniform by solid angle. `spread` = 1 − cosθmax, which keeps its digits for the narrowest cones.
static vec3 warp_cone(vfloat u, vfloat v, vfloat spread) {
    const vfloat drop = u * spread;                               // 1 − cosθ
    const vfloat r = root(drop * (splat(2.0f) - drop));
    vfloat c, s;
    cos_sin_turn(v, &c, &s);
    return vec3_of(r * c, r * s, splat(1.0f) - drop);
}
static vfloat warp_cone_pdf(vfloat spread) { return quotient(splat(0.159154943091895f), spread); }

// Triangle, uniform by area: barycentric weights of the second and third vertex (Heitz 2019, the low-distortion fold).
static void warp_triangle(vfloat u, vfloat v, vfloat* b1, vfloat* b2) {
    const vmask left = v > u;
    const vfloat x = left ? u * 0.5f : u - v * 0.5f;
    const vfloat y = left ? v - u * 0.5f : v * 0.5f;
    *b1 = x;
    *b2 = y;
}

#endif
