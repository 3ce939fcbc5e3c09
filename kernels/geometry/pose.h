// Meshes that change their form while the shutter is open: their vertices at several times, between which each goes straight.
//
// A mesh of this kind is a group of its own, with one instance or more. Its rows follow the knots of motions: for each knot in time one row for
// each triangle, with its corners, and then likewise the normals there if it has any. The tree is over all that a triangle passes; where a ray
// meets one is decided at the ray's time, by the test of all triangles. Corners that triangles share are the same in each of them at all times.
#ifndef GEOMETRY_POSE_H
#define GEOMETRY_POSE_H

#include "core/lane.h"
#include "geometry/bvh.h"
#include "geometry/wide.h"
#include "types.h"

#ifdef DEFORMATION

// Where the rows of a mesh are: the first, how many a knot has, how many knots there are; 0 of what does not change its form.
typedef struct {
    uint first, stride, knots;
} Poses;

// Two rows of a triangle, of the knots before and after each lane's time, and how far that is from the first one.
static void pose_rows(__global const float* rows, vuint first, vuint stride, vuint knots, vfloat time, vuint* before, vuint* after, vfloat* share) {
    vuint low = splat_uint(0u), high = knots > 1u ? knots - 2u : splat_uint(0u);
    while (lane_any(low < high)) {
        const vuint middle = (low + high + 1u) >> 1;
        const vmask reached = lane_gather(rows, (first + middle * stride) * 16u + MOTION_ROW_TIME) <= time;
        high = reached | !(low < high) ? high : middle - 1u;
        low = reached ? middle : low;
    }
    vfloat knot[16];
    *before = first + low * stride;
    *after = knots > 1u ? *before + stride : *before;
    lane_rows(rows, *before, knot);
    *share = motion_share_lanes(knot, time);
}

// Nine numbers between two rows.
static void pose_numbers(__global const float* rows, vuint before, vuint after, vfloat share, vfloat numbers[9]) {
    vfloat a[16], b[16];
    lane_rows(rows, before, a);
    lane_rows(rows, after, b);
    for (int k = 0; k < 9; ++k) numbers[k] = pose_between_lanes(a[k], b[k], share);
}

// The rows of an instance's mesh.
static Poses poses_of(const Bvh* bvh, uint instance) {
    __global const uint* motion = bvh->instance_motions + (size_t)instance * INSTANCE_MOTION_WORDS;
    __global const float* placement = bvh->instance_rows + (size_t)instance * INSTANCE_WORDS + 16;
    Poses p;
    p.first = motion[2];
    p.knots = motion[3];
    p.stride = as_uint(placement[PLACEMENT_ROW_FIRST_ANALYTIC]) - as_uint(placement[PLACEMENT_ROW_FIRST]);
    return p;
}

#endif

#endif
