// Single operations on given operands, for the check that tells which one a driver does not compute exactly.
// Rows of ten results: + - * / sqrt fma floor, int to float, uint to float, float to int. Every NaN becomes 0x7fc00000.
#include "core/quotient.h"

#define RESULTS 10

#define ARITHMETIC(FLOAT, INT, UINT, AS_FLOAT, AS_INT, AS_UINT, FROM_INT, FROM_UINT, TO_INT, WIDTH)         \
    FLOAT a = AS_FLOAT(bits_a), b = AS_FLOAT(bits_b), c = AS_FLOAT(bits_c);                                 \
    FLOAT floats[RESULTS - 1] = {                                                                           \
        a + b, a - b, a * b, quotient_##WIDTH(a, b), square_root_##WIDTH(fabs(a)), fma(a, b, c), floor(a),      \
        FROM_INT(AS_INT(bits_a)), FROM_UINT(bits_a)};                                                       \
    /* A conversion out of range is undefined, so the ends of int are cut off first. */                     \
    FLOAT inside = fmin(fmax(a, (FLOAT)(-2147483520.0f)), (FLOAT)(2147483520.0f));                          \
    UINT integer = AS_UINT(TO_INT(inside));

kernel void arithmetic_scalar(global const uint *operands, global uint *results) {
    size_t row = get_global_id(0);
    uint bits_a = operands[3 * row], bits_b = operands[3 * row + 1], bits_c = operands[3 * row + 2];
    ARITHMETIC(float, int, uint, as_float, as_int, as_uint, convert_float, convert_float, convert_int, lanes)
    for (int k = 0; k < RESULTS - 1; ++k)
        results[row * RESULTS + k] = isnan(floats[k]) ? 0x7fc00000u : as_uint(floats[k]);
    results[row * RESULTS + RESULTS - 1] = integer;
}

kernel void arithmetic_vector(global const uint *operands, global uint *results) {
    size_t first = 8 * get_global_id(0);
    uint gathered[3][8];
    for (int lane = 0; lane < 8; ++lane)
        for (int k = 0; k < 3; ++k)
            gathered[k][lane] = operands[3 * (first + lane) + k];
    uint8 bits_a = vload8(0, gathered[0]), bits_b = vload8(0, gathered[1]), bits_c = vload8(0, gathered[2]);
    ARITHMETIC(float8, int8, uint8, as_float8, as_int8, as_uint8, convert_float8, convert_float8, convert_int8, pack)
    for (int k = 0; k < RESULTS; ++k) {
        uint stored[8];
        if (k < RESULTS - 1) {
            uint8 bits = select(as_uint8(floats[k]), (uint8)(0x7fc00000u), isnan(floats[k]));
            vstore8(bits, 0, stored);
        } else
            vstore8(integer, 0, stored);
        for (int lane = 0; lane < 8; ++lane)
            results[(first + lane) * RESULTS + k] = stored[lane];
    }
}
