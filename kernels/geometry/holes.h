// What is known of holes without a look at the texture: two bits for each cell of a grid on a triangle say that it is a hole all over, or whole
// (Gruen, Benthin and Woop, "Sub-triangle opacity masks for faster ray tracing of transparent objects", HPG 2020).
//
// The host leaves out cells that rounding might shift a hit out of (clrender/flatten/holes.py). So the bits change no image: what they
// do not say, the texture does (geometry/find.h). Nor has it bits for triangles that the tree turns (triangle.h), whose weights are others'.
//
// Built only where a scene has such triangles (-D HOLES).
#ifndef GEOMETRY_HOLES_H
#define GEOMETRY_HOLES_H

#ifdef HOLES

#include "core/exact.h"
#include "geometry/bvh.h"
#include "types.h"

// The bit of the cell at these weights of B and C, times HOLE_GRID.
static uint holes_bit(float b, float c) {
    const float last = (float)(HOLE_GRID - 1u);
    const uint column = (uint)(b > 0.0f ? (b < last ? b : last) : 0.0f), line = (uint)(c > 0.0f ? (c < last ? c : last) : 0.0f);
    return line * HOLE_GRID + column;
}

// What is known of a hit.
#define HOLES_UNKNOWN 0
#define HOLES_HOLE 1
#define HOLES_SOLID 2

// Of a hit of a unit of the tree. The weights of B and C are times the determinant's size; of a parallelogram, whose triangles are A B C
// and A C D, they are those of B and D.
static int holes_at(const Bvh* bvh, uint word, float determinant, float weight_b, float weight_c) {
    const uint pair = word >> 31, later = weight_c > weight_b ? pair : 0u;
    const float cells = quotient_one((float)HOLE_GRID, determinant < 0.0f ? -determinant : determinant), b = weight_b * cells, c = weight_c * cells;
    const uint bit = later ? holes_bit(b, c - b) : holes_bit(pair ? b - c : b, c);
    const uint primitive = (word & ~(BVH_PAIR | BVH_NUMBER)) + later, words = HOLE_GRID * HOLE_GRID / 32u;
    const uint row = as_uint(bvh->attribute_rows[(size_t)primitive * 16 + ATTRIBUTE_ROW_HOLES]);
    __global const uint* bits = bvh->hole_rows + row * 2u * words + bit / 32u;
    return bits[0] >> bit % 32u & 1u ? HOLES_HOLE : bits[words] >> bit % 32u & 1u ? HOLES_SOLID : HOLES_UNKNOWN;
}

#endif

#endif
