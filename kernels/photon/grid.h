// The photon map: deposits in the order of the cells of a regular grid, which says for every cell where its own begin. In a cell they
// keep the order of their photons, so that sums over them have one order.
#ifndef PHOTON_GRID_H
#define PHOTON_GRID_H

#include "core/lane.h"

// `low` and cells per metre; cells along each axis. The last of `size` is their number.
typedef struct {
    float4 low;
    uint4 size;
} Grid;

// Cell along one axis. Rounding is monotonic: what lies between two points is in a cell between theirs.
static uint grid_along(float x, float low, float per_metre, uint size) {
    const float at = (x - low) * per_metre;
    return at >= 1.0f ? min((uint)(at < 1.0e6f ? at : 1.0e6f), size - 1u) : 0u;
}

#endif
