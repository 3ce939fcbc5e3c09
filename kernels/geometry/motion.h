// Motion: maps that change while the shutter is open. Built only where a scene has any (-D MOTION).
//
// A map is given at knots in time as a stretch, a rotation and a translation (Shoemake and Duff, "Matrix animation and polar decomposition", 1992).
// Between two knots quaternions are interpolated linearly, which makes a rotation of every length of theirs, and so are all other numbers. The host
// sets knots so close that this is the motion that was asked for (clrender/flatten/motion.py). What moves are instances of groups, and the camera.
//
// A time is a share of the interval from the opening of the shutter to its end, in [0, 1) and a multiple of 2^-24. A path has one for all of its rays.
#ifndef GEOMETRY_MOTION_H
#define GEOMETRY_MOTION_H

#include "core/exact.h"
#include "core/lane.h"
#include "geometry/wide.h"
#include "types.h"

#ifdef MOTION

typedef struct {
    vfloat linear[9], offset[3], inverse[9];
} MotionMap;

// Of the knots from `first` on, one more than `segments`, the one from which the way leads on at each lane's time.
static vuint motion_knot(__global const float* knots, vuint first, vuint segments, vfloat time) {
    vuint low = first, high = first + (segments > 0u ? segments - 1u : splat_uint(0u));
    while (lane_any(low < high)) {
        const vuint middle = (low + high + 1u) >> 1;
        const vmask reached = lane_gather(knots, middle * 16u + MOTION_ROW_TIME) <= time;
        high = reached | !(low < high) ? high : middle - 1u;       // lanes that are done wait for the others
        low = reached ? middle : low;
    }
    return low;
}

static void motion_at(__global const float* knots, vuint first, vuint segments, vfloat time, MotionMap* map) {
    vfloat a[16], b[16];
    const vuint knot = motion_knot(knots, first, segments, time);
    lane_rows(knots, knot, a);
    lane_rows(knots, segments > 0u ? knot + 1u : knot, b);
    motion_between_lanes(a, b, motion_share_lanes(a, time), map->linear, map->offset, map->inverse);
}

static vec3 motion_turned(const vfloat matrix[9], vec3 v) {
    const vfloat given[3] = {v.x, v.y, v.z};
    vfloat turned[3];
    motion_turn_lanes(matrix, given, turned);
    return vec3_row(turned, 0);
}
static vec3 motion_offset(const MotionMap* map) { return vec3_row(map->offset, 0); }
static vec3 motion_point(const MotionMap* map, vec3 p) { return add(motion_turned(map->linear, p), motion_offset(map)); }
// The same backwards, from where it has moved to.
static vec3 motion_point_back(const MotionMap* map, vec3 p) { return motion_turned(map->inverse, sub(p, motion_offset(map))); }

// A ray's way back, one ray alone.
static void motion_back_one(__global const float* knots, uint first, uint segments, float time, float origin[3], float direction[3]) {
    uint low = first, high = first + segments - 1u;
    while (low < high) {
        const uint middle = (low + high + 1u) >> 1;
        if (knots[(size_t)middle * 16 + MOTION_ROW_TIME] <= time) low = middle;
        else high = middle - 1u;
    }
    float a[16], b[16], linear[9], offset[3], inverse[9], from[3], way[3];
    for (int k = 0; k < 16; ++k) a[k] = knots[(size_t)low * 16 + k], b[k] = knots[(size_t)low * 16 + 16 + k];
    motion_between_one(a, b, motion_share_one(a, time), linear, offset, inverse);
    for (int k = 0; k < 3; ++k) from[k] = origin[k] - offset[k], way[k] = direction[k];
    motion_turn_one(inverse, from, origin);
    motion_turn_one(inverse, way, direction);
}

#endif

#endif
