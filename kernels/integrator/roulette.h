// Russian roulette (Arvo and Kirk 1990): a path goes on with some probability, and then counts for more.
#ifndef INTEGRATOR_ROULETTE_H
#define INTEGRATOR_ROULETTE_H

#include "core/exact.h"
#include "types.h"

#define ROULETTE_MOST 0.95f
// From so many scattering events on a path may end whatever roulette was asked for: between surfaces that absorb nothing, none would.
// Without bias as ever; with so large a chance to go on, because weights grow by as much as it is below the reflectance.
#define ROULETTE_LONG_PATH 1024u
#define ROULETTE_LONG_MOST 0.998046875f

// The probability that a path goes on, of this throughput and so many events, after a surface with this absorption.
static vfloat roulette_survival(uint roulette, vec3 throughput, vuint depth, vfloat absorption) {
    vfloat survival = splat(1.0f);
    if (roulette == ROULETTE_ABSORPTION) survival = splat(1.0f) - absorption;
    if (roulette == ROULETTE_THROUGHPUT) survival = depth >= 4u ? lesser(largest(throughput), splat(ROULETTE_MOST)) : survival;
    return depth >= ROULETTE_LONG_PATH ? lesser(survival, splat(ROULETTE_LONG_MOST)) : survival;
}

// Whether that can be less than 1 for any of them.
static int roulette_matters(uint roulette, vuint depth) { return roulette != ROULETTE_NONE || lane_any(depth >= ROULETTE_LONG_PATH); }

#endif
