// What the kernels that build the tree share: boxes, and the binary tree that they make before the wide one.
#ifndef GEOMETRY_BUILD_H
#define GEOMETRY_BUILD_H

#include "geometry/bvh.h"
#include "geometry/wide.h"
#include "types.h"

// Work-items of the sort and the scans go through this many elements one after the other.
#define BUILD_CHUNK 1024u

// The binary tree: nodes [0, n) are the primitives in Morton order, the others follow as they are made. `members` of a node:
// how many primitives, and of which kinds.
#define MEMBERS_COUNT 0x3fffffffu
#define MEMBERS_TRIANGLE 0x40000000u
#define MEMBERS_ROUND 0x80000000u

typedef struct {
    float low[3], high[3];
} Box;

static Box box_load(__global const float* boxes, size_t index) {
    Box b;
    for (int k = 0; k < 3; ++k) {
        b.low[k] = boxes[index * 6 + k];
        b.high[k] = boxes[index * 6 + 3 + k];
    }
    return b;
}
static void box_save(__global float* boxes, size_t index, Box b) {
    for (int k = 0; k < 3; ++k) {
        boxes[index * 6 + k] = b.low[k];
        boxes[index * 6 + 3 + k] = b.high[k];
    }
}
static Box box_union(Box a, Box b) {
    for (int k = 0; k < 3; ++k) {
        a.low[k] = lesser(a.low[k], b.low[k]);
        a.high[k] = greater(a.high[k], b.high[k]);
    }
    return a;
}
static Box box_empty(void) {
    Box b;
    for (int k = 0; k < 3; ++k) b.low[k] = FAR, b.high[k] = -FAR;
    return b;
}
// Half the surface area.
static float box_area(Box b) {
    const float x = b.high[0] - b.low[0], y = b.high[1] - b.low[1], z = b.high[2] - b.low[2];
    return fma(x, y, fma(y, z, z * x));
}

#endif
