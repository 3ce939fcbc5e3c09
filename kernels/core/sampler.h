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

// The sets of dimensions. Those of a path's vertices repeat, SETS_PER_BOUNCE apart.
#define SET_PIXEL 0u
#define SET_LENS 1u
#define SET_LIGHT 2u
#define SET_MATERIAL 3u
#define SET_ROULETTE 4u
#define SETS_PER_BOUNCE 3u

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

static Sampler sampler_start(uint seed, vuint pixel, vuint index) {
    Sampler s;
    s.seed = hash_pair(hash_pair(pixel, splat_uint(seed)), splat_uint(0x5851f42du));
    s.index = index;
    return s;
}

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
// The same for a set of the path's vertex at `bounce`, as bits.
static void sampler_bounce_bits(Sampler s, uint set, vuint bounce, vuint* a, vuint* b) {
    sampler_bits(s, bounce * SETS_PER_BOUNCE + set, a, b);
}

// Choose among n by a number of 32 random bits: the choice, and what is left of the number as new bits.
static vuint sampler_pick(vuint bits, uint n, vuint* rest) {
    const vuint choice = mul_hi(bits, splat_uint(n));
    *rest = bits * n;
    return choice;
}

#endif
