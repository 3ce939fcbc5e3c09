// The intersection tests in the widths they are needed in: `_lanes`, LANES rays against one primitive, and `_pack`, one ray
// against the eight members of a node or a pack. One text serves both, so both give the same bits.
#ifndef GEOMETRY_WIDE_H
#define GEOMETRY_WIDE_H

#include "core/exact.h"
#include "geometry/box.h"
#include "geometry/triangle.h"

#define F vfloat
#define I vmask
#define BITS(x) vfloat_bits(x)
#define FROM_BITS(x) vfloat_from_bits(x)
#define WIDE(name) name##_lanes
#include "geometry/box.inc"
#include "geometry/triangle.inc"
#include "geometry/sphere.inc"
#undef F
#undef I
#undef BITS
#undef FROM_BITS
#undef WIDE

#define F float8
#define I int8
#define BITS(x) as_uint8(x)
#define FROM_BITS(x) as_float8(x)
#define WIDE(name) name##_pack
#include "geometry/box.inc"
#include "geometry/triangle.inc"
#include "geometry/sphere.inc"
#undef F
#undef I
#undef BITS
#undef FROM_BITS
#undef WIDE

#endif
