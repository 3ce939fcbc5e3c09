// Deposits become a photon map. Between the kernels the host sorts keys and values.
#include "core/quotient.h"
#include "photon/deposit.h"
#include "photon/grid.h"
#include "types.h"

// The cell of each place for a deposit; those without one come last. keys, values: [photon_count * 8].
// With `media`, those of media have cells of their own after those of surfaces.
__kernel void grid_keys(__global const float* deposits, __global const uint* deposit_counts, uint count, float4 low, uint4 size, uint media,
                        __global ulong* keys, __global uint* values) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    __global const float* deposit = deposits + (size_t)i * DEPOSIT_WORDS;
    uint cell = media ? 2u * size.w : size.w;
    if (i % PHOTON_DEPOSITS < deposit_counts[i / PHOTON_DEPOSITS]) {
        __global const float* point = deposit + DEPOSIT_ROW_POINT;
        const uint x = grid_along(point[0], low.x, low.w, size.x), y = grid_along(point[1], low.y, low.w, size.y);
        cell = (grid_along(point[2], low.z, low.w, size.z) * size.y + y) * size.x + x;
        const uint kind = as_uint(deposit[DEPOSIT_ROW_KIND]);
        if (media && kind != 0u && (kind & DEPOSIT_FROM) == 0u) cell += size.w;
    }
    keys[i] = cell;
    values[i] = i;
}

// Where each cell begins, from the sorted keys. starts: [cells + 1].
__kernel void grid_starts(__global const ulong* keys, uint count, uint cells, __global uint* starts) {
    const uint i = (uint)get_global_id(0);
    if (i > count) return;
    const uint before = i > 0 ? (uint)keys[i - 1] + 1u : 0u, here = i < count ? (uint)keys[i] : cells;
    for (uint cell = before; cell <= here; ++cell) starts[cell] = i;
}

// The deposits in their order, number by number, and eight zeros after them, because they are read eight at a time: map [words][stride]. Those that a photon did not keep are stood for by those it did.
__kernel void grid_place(__global const float* deposits, __global const uint* deposit_counts, __global const uint* values,
                         __global const uint* starts, uint cells, uint stride, uint words, __global float* map) {
    const uint i = (uint)get_global_id(0);
    const uint kept = starts[cells];
    if (i >= kept) {
        for (uint k = 0; i < kept + 8u && k < words; ++k) map[(size_t)k * stride + i] = 0.0f;
        return;
    }
    __global const float* deposit = deposits + (size_t)values[i] * DEPOSIT_WORDS;
    const uint made = deposit_counts[values[i] / PHOTON_DEPOSITS];
    // A photon of a caustic counts on a smaller disk, or ball, and so for more
    const float density = deposit[DEPOSIT_ROW_EVENTS] < 0.0f ? quotient_one(1.0f, CAUSTIC_RADIUS * CAUSTIC_RADIUS) : 1.0f;
    const float share = density * (made > PHOTON_DEPOSITS ? quotient_one((float)made, (float)PHOTON_DEPOSITS) : 1.0f);
    for (uint k = 0; k < words; ++k) map[(size_t)k * stride + i] = k - DEPOSIT_ROW_FLUX < 3u ? deposit[k] * share : deposit[k];
}
