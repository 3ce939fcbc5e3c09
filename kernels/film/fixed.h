// Sums of samples: 128-bit fixed point, quantum 2^-64, two's complement, so that a sum does not depend on the order or the grouping of its
// terms. What is not finite, or of magnitude 2^43 or more, is not representable; what is below the quantum is cut off.
#ifndef FILM_FIXED_H
#define FILM_FIXED_H

typedef struct {
    ulong low, high;
} Fixed;

static int fixed_representable(float value) {
    return (as_uint(value) & 0x7fffffffu) < ((43u + 127u) << 23);
}

// Of the magnitude of a number.
static Fixed fixed_of(float value) {
    const uint bits = as_uint(value);
    const uint biased = (bits >> 23) & 0xffu;
    const ulong mantissa = biased ? (bits & 0x7fffffu) | 0x800000u : bits & 0x7fffffu;
    const int shift = (int)(biased ? biased : 1u) - 150 + 64;       // of the mantissa's last bit against the quantum
    Fixed term = {0, 0};
    if (shift <= -24 || mantissa == 0) return term;
    if (shift < 0) {
        term.low = mantissa >> -shift;
    } else if (shift < 64) {
        term.low = mantissa << shift;
        term.high = shift > 40 ? mantissa >> (64 - shift) : 0;
    } else {
        term.high = mantissa << (shift - 64);
    }
    return term;
}

static Fixed fixed_sum(Fixed a, Fixed b) {
    const ulong low = a.low + b.low;
    const Fixed sum = {low, a.high + b.high + (low < b.low)};
    return sum;
}

static Fixed fixed_negative(Fixed a) {
    const ulong low = ~a.low + 1;
    const Fixed negative = {low, ~a.high + (low == 0)};
    return negative;
}

static Fixed fixed_add(Fixed before, float value) {
    const Fixed term = fixed_of(value);
    return fixed_sum(before, as_uint(value) >> 31 ? fixed_negative(term) : term);
}

static Fixed fixed_subtract(Fixed a, Fixed b) {
    const Fixed difference = {a.low - b.low, a.high - b.high - (a.low < b.low)};
    return difference;
}

#endif
