// Search in a table of numbers that grow.
#ifndef CORE_SEARCH_H
#define CORE_SEARCH_H

#include "core/lane.h"

// Of places low to high the last one whose number is not above what is sought, or `low`; numbers grow, and stand `stride` words apart.
static vuint search_last(__global const float* numbers, vuint begin, uint stride, vfloat sought, vuint low, vuint high) {
    while (lane_any(low < high)) {
        const vuint middle = (low + high + 1u) >> 1;
        const vmask reached = lane_gather(numbers, begin + middle * stride) <= sought;
        high = reached | !(low < high) ? high : middle - 1u;       // lanes that are done wait for the others
        low = reached ? middle : low;
    }
    return low;
}

#endif
