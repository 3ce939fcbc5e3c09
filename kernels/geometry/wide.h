// The intersection tests in the widths they are needed in: `_lanes`, LANES rays against one primitive, and `_pack`, one ray
// against the eight members of a node or a pack; and what rays are prepared with, for LANES of them and for `_one`. One text serves
// all, so all give the same bits.
#ifndef GEOMETRY_WIDE_H
#define GEOMETRY_WIDE_H

#include "core/exact.h"
#include "geometry/box.h"
#include "geometry/triangle.h"
#include "types.h"

// Over all members.
static int any_of_eight(int8 m) { return as_long(convert_char8(m)) != 0; }

#define F vfloat
#define I vmask
#define ANY(m) lane_any(m)
#define BITS(x) vfloat_bits(x)
#define FROM_BITS(x) vfloat_from_bits(x)
#define WIDE(name) name##_lanes
#include "geometry/ray.inc"
#ifdef MOTION
#include "geometry/motion.inc"
#endif
#include "geometry/box.inc"
#include "geometry/triangle.inc"
#ifdef DEFORMATION
#include "geometry/pose.inc"
#endif
#include "geometry/sphere.inc"
#include "geometry/rectangle.inc"
#ifdef CURVES
#include "geometry/curve.inc"
#endif
#undef F
#undef I
#undef BITS
#undef FROM_BITS
#undef ANY
#undef WIDE

#define F float
#define I int
#define BITS(x) as_uint(x)
#define FROM_BITS(x) as_float(x)
#define WIDE(name) name##_one
#include "geometry/ray.inc"
#ifdef MOTION
#include "geometry/motion.inc"
#endif
#undef F
#undef I
#undef BITS
#undef FROM_BITS
#undef WIDE

#define F float8
#define I int8
#define ANY(m) any_of_eight(m)
#define BITS(x) as_uint8(x)
#define FROM_BITS(x) as_float8(x)
#define WIDE(name) name##_pack
#include "geometry/box.inc"
#include "geometry/triangle.inc"
#ifdef DEFORMATION
#include "geometry/pose.inc"
#endif
#include "geometry/sphere.inc"
#include "geometry/rectangle.inc"
#ifdef CURVES
#include "geometry/curve.inc"
#endif
#undef F
#undef I
#undef BITS
#undef FROM_BITS
#undef ANY
#undef WIDE

static int count_of_eight(int8 m) { return (int)(popcount(as_ulong(convert_char8(m))) >> 3); }
static float least_of_eight(float8 x) {
    const float4 h = x.lo < x.hi ? x.lo : x.hi;
    const float2 p = h.lo < h.hi ? h.lo : h.hi;
    return p.x < p.y ? p.x : p.y;
}
static uint least_uint_of_eight(uint8 x) {
    const uint4 h = x.lo < x.hi ? x.lo : x.hi;
    const uint2 p = h.lo < h.hi ? h.lo : h.hi;
    return p.x < p.y ? p.x : p.y;
}

// Of eight numbers the larger ones first: a bitonic network (Batcher 1968).
static uint8 eight_sorted(uint8 x) {
    uint8 other, more, less;
    other = x.s10325476, more = x > other ? x : other, less = x > other ? other : x;
    x = (uint8)(more.s0, less.s1, less.s2, more.s3, more.s4, less.s5, less.s6, more.s7);
    other = x.s23016745, more = x > other ? x : other, less = x > other ? other : x;
    x = (uint8)(more.s0, more.s1, less.s2, less.s3, less.s4, less.s5, more.s6, more.s7);
    other = x.s10325476, more = x > other ? x : other, less = x > other ? other : x;
    x = (uint8)(more.s0, less.s1, more.s2, less.s3, less.s4, more.s5, less.s6, more.s7);
    other = x.s45670123, more = x > other ? x : other, less = x > other ? other : x;
    x = (uint8)(more.s0, more.s1, more.s2, more.s3, less.s4, less.s5, less.s6, less.s7);
    other = x.s23016745, more = x > other ? x : other, less = x > other ? other : x;
    x = (uint8)(more.s0, more.s1, less.s2, less.s3, more.s4, more.s5, less.s6, less.s7);
    other = x.s10325476, more = x > other ? x : other, less = x > other ? other : x;
    x = (uint8)(more.s0, less.s1, more.s2, less.s3, more.s4, less.s5, more.s6, less.s7);
    return x;
}

#if LANES > 1
// For every set of eight members those that are in it, a byte each, from the lowest on.
#define FRONT_STEP(m, i, then) (((then) << (8 * ((m) >> (i) & 1))) | (ulong)((i) * ((m) >> (i) & 1)))
#define FRONT_HALF(m) FRONT_STEP(m, 4, FRONT_STEP(m, 5, FRONT_STEP(m, 6, FRONT_STEP(m, 7, 0ul))))
#define FRONT(m) FRONT_STEP(m, 0, FRONT_STEP(m, 1, FRONT_STEP(m, 2, FRONT_STEP(m, 3, FRONT_HALF(m)))))
#define FRONT_4(m) FRONT(m), FRONT(m + 1), FRONT(m + 2), FRONT(m + 3)
#define FRONT_16(m) FRONT_4(m), FRONT_4(m + 4), FRONT_4(m + 8), FRONT_4(m + 12)
#define FRONT_64(m) FRONT_16(m), FRONT_16(m + 16), FRONT_16(m + 32), FRONT_16(m + 48)
__constant ulong eight_sets[256] = {FRONT_64(0), FRONT_64(64), FRONT_64(128), FRONT_64(192)};

// The numbers of the members for which this holds, as they lie; then zeros. What the language has for it no compiler makes an instruction of, and
// a sorting network takes six times as many.
static uint8 eight_to_front(int8 m) {
    const ulong set = (as_ulong(convert_char8(m)) & 0x8040201008040201ul) * 0x0101010101010101ul >> 56;
    return convert_uint8(as_uchar8(eight_sets[set]));
}
#endif

// The members `order` names, in its order. What the language has for it goes through memory on some CPU drivers; of single members
// their compilers make one instruction.
static uint8 eight_in_order(uint8 x, uint8 order) {
#if LANES == 1
    return shuffle(x, order);
#else
    return (uint8)(x[order.s0], x[order.s1], x[order.s2], x[order.s3], x[order.s4], x[order.s5], x[order.s6], x[order.s7]);
#endif
}

#endif
