// Divisions and square roots, rounded correctly on every device.
//
// OpenCL lets a device be 2.5 units in the last place off in a division and 3 in a square root, unless it says that it rounds both
// correctly (CL_FP_CORRECTLY_ROUNDED_DIVIDE_SQRT). Where it does not say so the host sets CORRECT_DIVIDE, and quotient.inc corrects
// what the device gives. Elsewhere these are the operations of the language, so kernels divide and take roots by these names only.
#ifndef CORE_QUOTIENT_H
#define CORE_QUOTIENT_H

#include "core/lane.h"

#ifdef CORRECT_DIVIDE

// For tests on devices that round: what they give is made wrong by up to QUOTIENT_ERROR units in the last place.
#ifndef QUOTIENT_ERROR
#define QUOTIENT_ERROR 0u
#endif

#define F vfloat
#define I vint
#define U vuint
#define BITS(x) vfloat_bits(x)
#define FROM_BITS(x) vfloat_from_bits(x)
#define SIGNED(x) vint_from_uint(x)
#define UNSIGNED(x) vuint_from_int(x)
#define WIDE(name) name##_lanes
#include "core/quotient.inc"

#if LANES == 1
#define quotient_one quotient_lanes
#define square_root_one square_root_lanes
#else
#define F float
#define I int
#define U uint
#define BITS(x) as_uint(x)
#define FROM_BITS(x) as_float(x)
#define SIGNED(x) as_int(x)
#define UNSIGNED(x) as_uint(x)
#define WIDE(name) name##_one
#include "core/quotient.inc"
#endif

#if LANES == 8
#define quotient_pack quotient_lanes
#define square_root_pack square_root_lanes
#else
#define F float8
#define I int8
#define U uint8
#define BITS(x) as_uint8(x)
#define FROM_BITS(x) as_float8(x)
#define SIGNED(x) as_int8(x)
#define UNSIGNED(x) as_uint8(x)
#define WIDE(name) name##_pack
#include "core/quotient.inc"
#endif

#else

#define quotient_lanes(a, b) ((a) / (b))
#define quotient_one(a, b) ((a) / (b))
#define quotient_pack(a, b) ((a) / (b))
#define square_root_lanes(x) sqrt(x)
#define square_root_one(x) sqrt(x)
#define square_root_pack(x) sqrt(x)

#endif

#define quotient(a, b) quotient_lanes(a, b)
#define square_root(x) square_root_lanes(x)

#endif
