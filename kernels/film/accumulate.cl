// Adds the samples of a launch to the pixels' sums, which are exact (film/fixed.h). A sample that is not finite, or of magnitude 2^43 or more, is
// left out and not counted.
//
// Where paths from lights splat (-D SPLATS), a launch is one sample of each pixel, and what they brought to it is part of that sample.
//
// Where samples come in replicates (core/sampler.h), the squares of the replicates' sums are summed up as well, in 256 bits and quanta of
// 2^-128, so that the variance between replicates is known exactly.
#include "core/sampler.h"
#include "film/fixed.h"
#include "film/mean.h"
#include "film/slot.h"

// Add the square of a number to a sum of four words, the lowest first.
static void fixed_add_square(ulong sum[4], Fixed number) {
    const Fixed m = number.high >> 63 ? fixed_negative(number) : number;
    const ulong cross = m.low * m.high, cross_high = mul_hi(m.low, m.high);
    ulong square[4] = {m.low * m.low, mul_hi(m.low, m.low), m.high * m.high, mul_hi(m.high, m.high)};
    const ulong twice[4] = {0, cross << 1, (cross_high << 1) | (cross >> 63), cross_high >> 63};
    ulong carry = 0;
    for (int k = 0; k < 4; ++k) {
        const ulong with_carry = square[k] + carry;
        carry = with_carry < carry;
        square[k] = with_carry + twice[k];
        carry += square[k] < twice[k];
    }
    carry = 0;
    for (int k = 0; k < 4; ++k) {
        const ulong with_carry = square[k] + carry;
        carry = with_carry < carry;
        sum[k] += with_carry;
        carry += sum[k] < with_carry;
    }
}

static Fixed fixed_load(__global const ulong* sums, size_t number) {
    const Fixed sum = {sums[number * 2], sums[number * 2 + 1]};
    return sum;
}
static void fixed_store(__global ulong* sums, size_t number, Fixed sum) {
    sums[number * 2] = sum.low;
    sums[number * 2 + 1] = sum.high;
}

#ifdef SPLATS
#define FILM_SPLATS , __global uint* splats
#define FILM_SPLATS_AT(place) , splats + (place) * 12
#else
#define FILM_SPLATS
#define FILM_SPLATS_AT(place)
#endif

// Add the samples [first, stop) of a slot to its sums; gives how many of them count.
static uint film_add(__global const float* samples, uint slot, uint slot_count, uint first, uint stop, Fixed sum[3] FILM_SPLATS) {
    uint accepted = 0;
    for (uint k = first; k < stop; ++k) {
        __global const float* sample = samples + (size_t)k * 3 * slot_count + slot;
        const float r = sample[0], g = sample[slot_count], b = sample[2 * (size_t)slot_count];
        if (!(fixed_representable(r) && fixed_representable(g) && fixed_representable(b))) continue;
        sum[0] = fixed_add(sum[0], r);
        sum[1] = fixed_add(sum[1], g);
        sum[2] = fixed_add(sum[2], b);
        ++accepted;
    }
#ifdef SPLATS
    for (int c = 0; c < 3; ++c) {
        __global uint* words = splats + c * 4;
        const Fixed brought = {words[0] | (ulong)words[1] << 32, words[2] | (ulong)words[3] << 32};
        if (accepted) sum[c] = fixed_sum(sum[c], brought);
        for (int k = 0; k < 4; ++k) words[k] = 0;
    }
#endif
    return accepted;
}

// samples: float [sample_count][3][slot_count] of the slots from first_slot on. sums: ulong [slot][3][2] (low, high) and counts:
// uint [slot], both from `offset` slots before that on.
__kernel void film_accumulate(__global const Settings* settings, __global const float* samples, uint first_slot, uint slot_count,
                              uint sample_count, uint offset, __global ulong* sums, __global uint* counts FILM_SPLATS) {
    const uint slot = (uint)get_global_id(0);
    uint x, y;
    if (slot >= slot_count || !slot_pixel(settings, slot_block(settings, first_slot + slot), first_slot + slot, &x, &y)) return;
    const size_t at = (size_t)(offset + slot);
    Fixed sum[3];
    for (int c = 0; c < 3; ++c) sum[c] = fixed_load(sums, at * 3 + c);
    counts[at] += film_add(samples, slot, slot_count, 0, sample_count, sum FILM_SPLATS_AT(at));
    for (int c = 0; c < 3; ++c) fixed_store(sums, at * 3 + c, sum[c]);
}

// Sums over the work-items of a launch. totals: ulong4 [rows].
__kernel void film_total_stats(__global const uint4* stats, uint count, __global ulong4* totals, uint rows) {
    const uint row = (uint)get_global_id(0);
    ulong4 total = (ulong4)(0);
    if (row >= rows) return;
    for (size_t item = row; item < count; item += rows) {
        const uint4 each = stats[item];
        total = (ulong4)(total.x + each.x, total.y + each.y, max(total.z, (ulong)each.z), 0);
    }
    totals[row] = total;
}

#ifdef SPLATS
// A new unit starts from nothing.
__kernel void film_clear_splats(__global uint* splats, uint slot_count) {
    const uint slot = (uint)get_global_id(0);
    if (slot >= slot_count) return;
    for (int k = 0; k < 12; ++k) splats[(size_t)slot * 12 + k] = 0;
}
#endif

// A new unit starts from nothing.
__kernel void film_clear(__global ulong* sums, __global uint* counts, uint slot_count) {
    const uint slot = (uint)get_global_id(0);
    if (slot >= slot_count) return;
    for (int k = 0; k < 6; ++k) sums[(size_t)slot * 6 + k] = 0;
    counts[slot] = 0;
}

// The same of samples from number `first_sample` on, which come in replicates. squares: ulong [slot][3][4], lowest word first, of whole
// replicates. start_sums, start_counts: sums and counts as they were before the replicate that is not whole yet, or the last one.
__kernel void film_accumulate_replicates(__global const Settings* settings, __global const float* samples, uint first_slot,
                                         uint slot_count, uint first_sample, uint sample_count, uint offset, __global ulong* sums,
                                         __global uint* counts, __global ulong* squares, __global ulong* start_sums,
                                         __global uint* start_counts FILM_SPLATS) {
    const uint slot = (uint)get_global_id(0);
    uint x, y;
    if (slot >= slot_count || !slot_pixel(settings, slot_block(settings, first_slot + slot), first_slot + slot, &x, &y)) return;
    const size_t at = (size_t)(offset + slot);
    const uint replicate_spp = settings->replicate_spp;
    Fixed sum[3], start[3];
    ulong square[3][4];
    for (int c = 0; c < 3; ++c) {
        sum[c] = fixed_load(sums, at * 3 + c);
        start[c] = fixed_load(start_sums, at * 3 + c);
        for (int k = 0; k < 4; ++k) square[c][k] = squares[(at * 3 + c) * 4 + k];
    }
    uint accepted = counts[at], start_accepted = start_counts[at];
    for (uint n = 0; n < sample_count;) {
        const uint within = sampler_within(first_sample + n, replicate_spp);
        if (within == 0) {
            for (int c = 0; c < 3; ++c) start[c] = sum[c];
            start_accepted = accepted;
        }
        const uint stop = min(sample_count, n + replicate_spp - within);
        const int whole = stop == n + replicate_spp - within;
        accepted += film_add(samples, slot, slot_count, n, stop, sum FILM_SPLATS_AT(at));
        n = stop;
        if (!whole) continue;
        for (int c = 0; c < 3; ++c) fixed_add_square(square[c], fixed_subtract(sum[c], start[c]));
    }
    for (int c = 0; c < 3; ++c) {
        fixed_store(sums, at * 3 + c, sum[c]);
        fixed_store(start_sums, at * 3 + c, start[c]);
        for (int k = 0; k < 4; ++k) squares[(at * 3 + c) * 4 + k] = square[c][k];
    }
    counts[at] = accepted;
    start_counts[at] = start_accepted;
}

// Nor has it any replicate. Slots outside the image keep what is written here.
__kernel void film_clear_replicates(__global ulong* squares, __global ulong* start_sums, __global uint* start_counts, uint slot_count) {
    const uint slot = (uint)get_global_id(0);
    if (slot >= slot_count) return;
    for (int k = 0; k < 12; ++k) squares[(size_t)slot * 12 + k] = 0;
    for (int k = 0; k < 6; ++k) start_sums[(size_t)slot * 6 + k] = 0;
    start_counts[slot] = 0;
}

// Samples of a pixel up to which its sum cannot leave its range: 2^126 quanta.
#define FILM_SAFE_COUNT (1u << 19)

// Add the sums of a unit to those of the image's rows [top, top + rows). film_sums: ulong [row][column][3][2], film_counts: uint [row][column].
// What leaves the range is told in `beyond`: 1 of a count, 2 of a sum.
__kernel void film_add_unit(__global const Settings* settings, uint first_slot, uint slot_count, uint top, uint rows,
                            __global const ulong* sums, __global const uint* counts, __global ulong* film_sums,
                            __global uint* film_counts, __global uint* beyond) {
    const uint slot = (uint)get_global_id(0);
    uint x, y;
    if (slot >= slot_count || !slot_pixel(settings, slot_block(settings, first_slot + slot), first_slot + slot, &x, &y)) return;
    if (y - top >= rows) return;        // also above them
    const size_t pixel = (size_t)(y - top) * slot_columns(settings) + x;
    const uint count = film_counts[pixel] + counts[slot];
    if (count < counts[slot]) beyond[0] = 1;
    for (int c = 0; c < 3; ++c) {
        const Fixed sum = fixed_sum(fixed_load(film_sums, pixel * 3 + c), fixed_load(sums, (size_t)slot * 3 + c));
        if (count >= FILM_SAFE_COUNT && (long)sum.high + ((long)1 << 62) < 0) beyond[1] = 1;
        fixed_store(film_sums, pixel * 3 + c, sum);
    }
    film_counts[pixel] = count;
}

// The same of the squares of replicates. film_squares: ulong [row][column][3][4].
__kernel void film_add_squares(__global const Settings* settings, uint first_slot, uint slot_count, uint top, uint rows,
                               __global const ulong* squares, __global ulong* film_squares) {
    const uint slot = (uint)get_global_id(0);
    uint x, y;
    if (slot >= slot_count || !slot_pixel(settings, slot_block(settings, first_slot + slot), first_slot + slot, &x, &y)) return;
    if (y - top >= rows) return;
    const size_t pixel = (size_t)(y - top) * slot_columns(settings) + x;
    for (int c = 0; c < 3; ++c) {
        ulong carry = 0;
        for (int k = 0; k < 4; ++k) {
            const ulong with_carry = squares[((size_t)slot * 3 + c) * 4 + k] + carry;
            carry = with_carry < carry;
            film_squares[(pixel * 3 + c) * 4 + k] += with_carry;
            carry += film_squares[(pixel * 3 + c) * 4 + k] < with_carry;
        }
    }
}

// Of blocks that were stopped within a replicate, only whole replicates count. cut: uint [block], whether to do so.
__kernel void film_cut_replicates(uint slot_count, __global const uint* cut, __global const ulong* start_sums,
                                  __global const uint* start_counts, __global ulong* sums, __global uint* counts) {
    const uint slot = (uint)get_global_id(0);
    if (slot >= slot_count || !cut[slot / 16]) return;
    for (int k = 0; k < 6; ++k) sums[(size_t)slot * 6 + k] = start_sums[(size_t)slot * 6 + k];
    counts[slot] = start_counts[slot];
}

// Words that are 0.
__kernel void film_clear_words(__global ulong* words, uint count) {
    const uint word = (uint)get_global_id(0);
    if (word < count) words[word] = 0;
}

// Means of pixels. image: float [pixel][3].
__kernel void film_develop(__global const ulong* film_sums, __global const uint* film_counts, uint pixel_count, __global float* image) {
    const uint pixel = (uint)get_global_id(0);
    if (pixel >= pixel_count) return;
    for (int c = 0; c < 3; ++c) image[(size_t)pixel * 3 + c] = mean_of(fixed_load(film_sums, (size_t)pixel * 3 + c), film_counts[pixel]);
}
