// The mean of a pixel: its exact sum over the number of its samples, rounded to double precision, divided in double precision and rounded to
// single precision, each to nearest, ties to even. In integers, as some devices have no double precision; clrender/film/fixed_point.py
// computes the same on the host.
#ifndef FILM_MEAN_H
#define FILM_MEAN_H

#include "film/fixed.h"

// The number of bits of the significand of double precision, and of single precision.
#define MEAN_DOUBLE 53
#define MEAN_SINGLE 24

// The `bits` leading bits of a number whose top bit is set, rounded; `more` is what follows its 64 bits. It may be 2^bits.
static ulong mean_rounded(ulong number, ulong more, int bits) {
    const ulong kept = number >> (64 - bits), cut = number << bits, tie = (ulong)1 << 63;
    return kept + (cut > tie || (cut == tie && (more != 0 || (kept & 1))));
}

static float mean_of(Fixed sum, uint count) {
    const ulong sign = sum.high >> 63;
    const Fixed m = sign ? fixed_negative(sum) : sum;
    if ((m.low | m.high) == 0) return 0.0f;
    const int zeros = m.high ? (int)clz(m.high) : 64 + (int)clz(m.low), by = zeros & 63;
    const ulong first = zeros < 64 ? m.high : m.low, second = zeros < 64 ? m.low : 0;
    const ulong top = by ? (first << by) | (second >> (64 - by)) : first;
    // The sum is dividend 2^power
    const ulong dividend = mean_rounded(top, second << by, MEAN_DOUBLE);
    int power = 128 - MEAN_DOUBLE - zeros - 64;
    const ulong whole_divisor = max(count, 1u);
    ulong quotient = dividend;
    if ((whole_divisor & (whole_divisor - 1)) == 0) {
        power -= 63 - (int)clz(whole_divisor);
    } else {
        // 64 + 32 bits of the quotient, and whether anything is left
        const ulong high = (dividend << 10) / whole_divisor, left = (dividend << 10) - high * whole_divisor;
        const ulong low = (left << 32) / whole_divisor, rest = (left << 32) - low * whole_divisor;
        const int shift = (int)clz(high);
        const ulong all = shift ? (high << shift) | ((low << 32) >> (64 - shift)) : high;
        quotient = mean_rounded(all, ((low << 32) << shift) | rest, MEAN_DOUBLE);
        power += 64 - MEAN_DOUBLE - 10 - shift;
    }
    // 2^52 <= quotient <= 2^53, and no mean is below the least normal number of single precision
    const ulong single = mean_rounded(quotient << (64 - MEAN_DOUBLE), 0, MEAN_SINGLE);
    if (quotient >> MEAN_DOUBLE) return as_float((uint)sign << 31 | (uint)(power + MEAN_DOUBLE + 127) << 23);
    const uint exponent = (uint)(power + MEAN_DOUBLE - 1 + 127);
    return as_float(((uint)sign << 31) | ((exponent << 23) + (uint)(single - (1u << (MEAN_SINGLE - 1)))));
}

#endif
