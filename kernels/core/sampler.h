// Random numbers: a function of (seed, pixel, sample, named set of dimensions), never a state that advances.
//
// Owen-scrambled Sobol points (Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4) 2020) in padded sets of two dimensions,
// each set with its own shuffle and scrambles. Sobol's first two dimensions need no tables: bit reversal, and Pascal's triangle
// modulo two as a five-step butterfly. Integers only.
#ifndef CORE_SAMPLER_H
#define CORE_SAMPLER_H

#include "core/lane.h"

typedef struct {
    vuint seed;      // of the pixel
    vuint index;     // number of the sample in the pixel's sequence
} Sampler;

// The sets of dimensions: eight for a path's start at the camera, or a photon's at a light, then eight for each of its vertices. Those
// that are not named are kept free, so that what is built later changes no image.
#define SETS_PER_BOUNCE 8u
#define SET_PIXEL 0u                       // of the start at the camera: place in the pixel
#define SET_LENS 1u                        // place on the lens
#define SET_TIME 2u                        // while the shutter is open
#define SET_WAVELENGTH 3u                  // wavelengths of the path
#define SET_LIGHT 0u                       // of a vertex, and of the start at a light: which light, and where on it
#define SET_LIGHT_DIGITS 1u                // more digits for the choice of the light
#define SET_BSDF 2u                        // direction
#define SET_LOBE 3u                        // free: which lobe of the BSDF
#define SET_ROULETTE 4u                    // Russian roulette
#define SET_MEDIUM 5u                      // free: distance and phase function
#define SET_TEXTURE 6u                     // texel; free: opacity
#define SET_SPARE 7u

// Wellons' low-bias mixer of 32 bits (hash-prospector, 2018).
static vuint hash(vuint x) {
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    x ^= x >> 16;
    return x;
}
static vuint hash_pair(vuint a, vuint b) { return hash(a ^ (b * 0x9e3779b9u + 0x7f4a7c15u)); }

static vuint reverse_bits(vuint x) {
    x = ((x >> 1) & 0x55555555u) | ((x & 0x55555555u) << 1);
    x = ((x >> 2) & 0x33333333u) | ((x & 0x33333333u) << 2);
    x = ((x >> 4) & 0x0f0f0f0fu) | ((x & 0x0f0f0f0fu) << 4);
    x = ((x >> 8) & 0x00ff00ffu) | ((x & 0x00ff00ffu) << 8);
    return (x >> 16) | (x << 16);
}
// Laine and Karras' permutation with Vegdahl's constants (2021): every bit depends on lower ones only.
static vuint permute_lower(vuint x, vuint seed) {
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return x;
}
// Pascal's triangle modulo 2 applied to the bits of x: Sobol's second dimension, bit-reversed.
static vuint pascal(vuint x) {
    x ^= (x >> 1) & 0x55555555u;
    x ^= (x >> 2) & 0x33333333u;
    x ^= (x >> 4) & 0x0f0f0f0fu;
    x ^= (x >> 8) & 0x00ff00ffu;
    return x ^ (x >> 16);
}
// [0, 1) in steps of 2^-24: the top bits.
static vfloat unit_interval(vuint x) { return vfloat_of(vint_from_uint(x >> 8)) * 5.9604645e-8f; }

// A pixel's sequence may be cut into replicates of so many samples, a power of two, or 0: it is not cut. Each replicate is the beginning
// of a sequence with a scrambling of its own, so that replicates are independent of each other, and alike. A sample's number is that of
// its replicate's first sample and one within the replicate; uncut, all samples are of the replicate 0.
static uint sampler_replicate(uint number, uint replicate_spp) { return number & (0u - replicate_spp); }
static uint sampler_within(uint number, uint replicate_spp) { return number & (replicate_spp - 1u); }

static Sampler sampler_start_in(uint seed, uint replicate, vuint pixel, vuint index) {
    Sampler s;
    s.seed = hash_pair(hash_pair(pixel, splat_uint(seed)), splat_uint(0x5851f42du + replicate));
    s.index = index;
    return s;
}
static Sampler sampler_start(uint seed, vuint pixel, vuint index) { return sampler_start_in(seed, 0u, pixel, index); }

// Two numbers in [0, 1) for a set of dimensions, as bits.
static void sampler_bits(Sampler s, vuint set, vuint* a, vuint* b) {
    const vuint key = hash_pair(s.seed, set);
    const vuint shuffled = reverse_bits(permute_lower(reverse_bits(s.index), key));
    *a = reverse_bits(permute_lower(shuffled, key * 0xa511e9b3u + 0x63d83595u));
    *b = reverse_bits(permute_lower(pascal(shuffled), key * 0x9e3779b1u + 0xc2b2ae35u));
}
static void sampler_hash_bits(Sampler s, vuint set, vuint* a, vuint* b) {
    const vuint key = hash_pair(s.seed ^ (set * 0x85ebca6bu), s.index);
    *a = key;
    *b = hash(key ^ 0x6a09e667u);
}

static void sampler_get(Sampler s, uint set, vfloat* a, vfloat* b) {
    vuint x, y;
    sampler_bits(s, splat_uint(set), &x, &y);
    *a = unit_interval(x);
    *b = unit_interval(y);
}
// A set of the path's vertex at `bounce`.
static vuint sampler_set(vuint bounce, uint set) { return (bounce + 1u) * SETS_PER_BOUNCE + set; }

// Number m of the n samplers that one sample is split into. They are the points n index + m of one sequence; beyond 2^32, where its
// points would repeat, of another.
static Sampler sampler_split(Sampler s, uint n, vuint m) {
    if (n == 1u) return s;
    const vuint first = s.index * n, index = first + m, carry = index < first ? splat_uint(1u) : splat_uint(0u);
    Sampler split;                   // a new one: where a function writes to its parameter, rusticl changes the caller's
    split.seed = s.seed ^ ((mul_hi(s.index, splat_uint(n)) + carry) * 0x9e3779b9u);
    split.index = index;
    return split;
}

// Choose among n by a number of 32 random bits: the choice, and what is left of the number as new bits. The choice takes log2 n of
// them away; `digits`, as many random bits again, stand in their place.
static vuint sampler_pick(vuint bits, uint n, vuint digits, vuint* rest) {
    *rest = add_sat(bits * n, mul_hi(digits, splat_uint(n)));
    return mul_hi(bits, splat_uint(n));
}

#endif
