// Russian roulette (Arvo and Kirk 1990): a path goes on with some probability, and then counts for more.
//
// Every path of every integrator survives by these functions. The probability is at least the share of light that the path carries, as
// far as that is below 1: survival below the albedo would let weights grow from event to event, and for an albedo near 1 their variance
// would be infinite. So between white surfaces, and in white media, paths are as long as light's.
//
// Where nothing is absorbed paths end as well: of those that get as far as event N = ROULETTE_LONG_PATH, N / n reach event n, and from
// ROULETTE_LONGEST_PATH on the eighth power of that, so that the mean length is finite, and no path so long that a device would wait for it.
// The variance is finite, too, for every albedo ρ below 1, because ρⁿ falls faster than any power of n / N grows: where 1 / (1 − ρ) is less
// than N this end does not come before absorption's. It is infinite only where light leaves white media with a density of events
// of n^(−3/2), as from an unbounded one: there no roulette makes both finite.
#ifndef CORE_ROULETTE_H
#define CORE_ROULETTE_H

#include "core/exact.h"
#include "types.h"

#define ROULETTE_LONG_PATH 8192u
#define ROULETTE_LONGEST_PATH 1048576u
#define ROULETTE_LOST_PATH 256u

// The probability that a path goes on which has come this far, in events of one kind: the same whatever roulette was asked for.
static vfloat roulette_late(vuint events) {
    const vmask late = events >= ROULETTE_LONG_PATH;
    if (!lane_any(late)) return splat(1.0f);
    const vfloat ends = quotient(splat(1.0f), vfloat_of(vint_from_uint(events + 1u))), most = splat(1.0f - 2.0f * EPSILON);
    const vfloat on = lesser(splat(1.0f) - ends, most), squared = on * on, fourth = squared * squared;
    return late ? (events >= ROULETTE_LONGEST_PATH ? fourth * fourth : on) : splat(1.0f);
}

// The same in a medium that has no end, where light that gets lost never comes back: (N / n)² of the paths reach event n, N = ROULETTE_LOST_PATH.
static vfloat roulette_lost(vuint events) {
    const vmask late = events >= ROULETTE_LOST_PATH;
    const vfloat on = splat(1.0f) - quotient(splat(1.0f), vfloat_of(vint_from_uint(events + 1u)));
    return late ? on * on : splat(1.0f);
}

// The probability for what carries this share of the flux that it began with.
static vfloat roulette_by_flux(vec3 flux) { return lesser(largest(flux), splat(1.0f)); }

// The probability that a path goes on after so many scattering events, the last at a surface that ends it with probability `termination`.
// `flux`: its throughput, times the square of the index where it is over that where it began; refraction scatters no light away.
static vfloat roulette_survival(uint roulette, vec3 flux, vuint depth, vfloat termination) {
    vfloat survival = splat(1.0f);
    if (roulette == ROULETTE_CONSTANT) survival = splat(1.0f) - termination;
    if (roulette == ROULETTE_THROUGHPUT) survival = depth >= 4u ? roulette_by_flux(flux) : survival;
    return survival * roulette_late(depth);
}

// Whether that can be less than 1 for any of them.
static int roulette_matters(uint roulette, vuint depth) { return roulette != ROULETTE_NONE || lane_any(depth >= ROULETTE_LOST_PATH); }

#endif
