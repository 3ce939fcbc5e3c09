// How a medium scatters: Henyey and Greenstein's phase function (1941). The cosine is that of the angle by which light turns, +1 straight on;
// its mean is g. Per steradian; of all directions the integral is 1, so a direction sampled with its density weighs 1.
#ifndef MEDIUM_PHASE_H
#define MEDIUM_PHASE_H

#include "core/exact.h"

// The square root's argument is at least (1 − |g|)².
static vfloat phase_eval(vfloat g, vfloat cosine) {
    const vfloat spread = greater(fma(g, fma(cosine, splat(-2.0f), g), splat(1.0f)), splat(1.0e-5f));
    return quotient(fma(g, -g, splat(1.0f)), spread * square_root(spread)) * 0.0795774715459477f;
}

// A direction's coordinates about the z axis along which light came (PBR 4ed, 11.3.1).
static vec3 phase_sample(vfloat g, vfloat u, vfloat v) {
    const vmask even = absolute(g) < 1.0e-3f;
    const vfloat some = even ? splat(1.0f) : g;
    const vfloat ratio = quotient(fma(some, -some, splat(1.0f)), fma(some, fma(u, splat(-2.0f), splat(1.0f)), splat(1.0f)));
    const vfloat turned = quotient(fma(ratio, -ratio, fma(some, some, splat(1.0f))), some * 2.0f);
    // Next to no preference: of the series in g, the first two terms
    const vfloat straight = fma(u, splat(-2.0f), splat(1.0f));
    const vfloat nearly = fma(g * 1.5f, fma(straight, -straight, splat(1.0f)), straight);
    const vfloat cosine = bounded(even ? nearly : turned, -1.0f, 1.0f), sine = root(splat(1.0f) - cosine * cosine);
    vfloat c, s;
    cos_sin_turn(v, &c, &s);
    return vec3_of(sine * c, sine * s, cosine);
}

#endif
