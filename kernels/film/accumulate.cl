// Adds the samples of a launch to the pixels' sums: 128-bit fixed point, quantum 2^-64, two's complement, so that the sum does not
// depend on the order or the grouping of its terms. A sample that is not finite, or of magnitude 2^43 or more, is left out and not
// counted; what is below the quantum is cut off.
#include "film/slot.h"

typedef struct {
    ulong low, high;
} Fixed;

static int fixed_representable(float value) {
    return (as_uint(value) & 0x7fffffffu) < ((43u + 127u) << 23);
}

static Fixed fixed_add(Fixed before, float value) {
    Fixed sum = before;
    const uint bits = as_uint(value);
    const uint biased = (bits >> 23) & 0xffu;
    const ulong mantissa = biased ? (bits & 0x7fffffu) | 0x800000u : bits & 0x7fffffu;
    const int shift = (int)(biased ? biased : 1u) - 150 + 64;       // of the mantissa's last bit against the quantum
    Fixed term = {0, 0};
    if (shift <= -24 || mantissa == 0) return sum;
    if (shift < 0) {
        term.low = mantissa >> -shift;
    } else if (shift < 64) {
        term.low = mantissa << shift;
        term.high = shift > 40 ? mantissa >> (64 - shift) : 0;
    } else {
        term.high = mantissa << (shift - 64);
    }
    if (bits >> 31) {
        term.low = ~term.low + 1;
        term.high = ~term.high + (term.low == 0);
    }
    sum.low += term.low;
    sum.high += term.high + (sum.low < term.low);
    return sum;
}

// samples: float [sample_count][3][slot_count] of the slots from first_slot on. sums: ulong [slot][3][2] (low, high) and counts:
// uint [slot], both from `offset` slots before that on.
__kernel void film_accumulate(__global const Settings* settings, __global const float* samples, uint first_slot, uint slot_count,
                              uint sample_count, uint offset, __global ulong* sums, __global uint* counts) {
    const uint slot = (uint)get_global_id(0);
    uint x, y;
    if (slot >= slot_count || !slot_pixel(settings, slot_block(settings, first_slot + slot), first_slot + slot, &x, &y)) return;
    const size_t at = (size_t)(offset + slot);
    Fixed sum[3];
    for (int c = 0; c < 3; ++c) {
        sum[c].low = sums[(at * 3 + c) * 2];
        sum[c].high = sums[(at * 3 + c) * 2 + 1];
    }
    uint accepted = 0;
    for (uint k = 0; k < sample_count; ++k) {
        __global const float* sample = samples + (size_t)k * 3 * slot_count + slot;
        const float r = sample[0], g = sample[slot_count], b = sample[2 * (size_t)slot_count];
        if (!(fixed_representable(r) && fixed_representable(g) && fixed_representable(b))) continue;
        sum[0] = fixed_add(sum[0], r);
        sum[1] = fixed_add(sum[1], g);
        sum[2] = fixed_add(sum[2], b);
        ++accepted;
    }
    for (int c = 0; c < 3; ++c) {
        sums[(at * 3 + c) * 2] = sum[c].low;
        sums[(at * 3 + c) * 2 + 1] = sum[c].high;
    }
    counts[at] += accepted;
}

// A new unit starts from nothing.
__kernel void film_clear(__global ulong* sums, __global uint* counts, uint slot_count) {
    const uint slot = (uint)get_global_id(0);
    if (slot >= slot_count) return;
    for (int k = 0; k < 6; ++k) sums[(size_t)slot * 6 + k] = 0;
    counts[slot] = 0;
}
