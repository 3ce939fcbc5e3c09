// Fills the packs of a tree, column by column, and makes a tree that exists fit what has moved: the packs' members and the nodes' children
// stay, their numbers and boxes become those of the new places.
#include "geometry/build_cost.h"
#include "geometry/triangle.h"

// Behind the last block: whoever reads eight columns from its last one on reads beyond it.
static void columns_end(__global float* end) {
    for (uint k = 0; k < 8; ++k) end[k] = 0.0f;
}

// The column of a triangle, or with BVH_PAIR of a parallelogram.
static void columns_put_triangle(__global float* column, uint unit, __global const float* vertices, __global const uint* triangles) {
    vec3 corner[6];
    for (uint k = 0; k < (unit & BVH_PAIR ? 6u : 3u); ++k) corner[k] = build_vertex(vertices, triangles, (size_t)(unit & ~BVH_PAIR) * 3 + k);
    Triangle t;
    if (unit & BVH_PAIR)
        t = triangle_pair_of(corner[0], corner[1], corner[2], corner[5]);
    else if (triangle_turns(corner[0], corner[1], corner[2]))
        t = triangle_of(corner[1], corner[2], corner[0]);
    else
        t = triangle_of(corner[0], corner[1], corner[2]);
    const vec3 vectors[4] = {t.a, t.ab, t.ca, t.normal};
    for (uint k = 0; k < 4; ++k) column[k * 24] = vectors[k].x, column[k * 24 + 8] = vectors[k].y, column[k * 24 + 16] = vectors[k].z;
    column[96] = t.size_ab, column[104] = t.unsure, column[112] = t.size_ca;
    column[TRIANGLE_ID] = as_float(unit | BVH_NUMBER);
}

// The column of a rectangle, a pair of triangles.
static void columns_put_rectangle(__global float* column, uint unit, __global const float* vertices, __global const uint* triangles) {
    vec3 corner[6];
    for (uint k = 0; k < 6; ++k) corner[k] = build_vertex(vertices, triangles, (size_t)(unit & ~BVH_PAIR) * 3 + k);
    const vec3 a = corner[0], b = corner[1], c = corner[2], d = corner[5];
    const uint axis = build_rectangle_axis(a, b, c, d), u = (axis + 1) % 3, v = (axis + 2) % 3;
    const float from[3] = {a.x, a.y, a.z}, to[3] = {c.x, c.y, c.z}, second[3] = {d.x, d.y, d.z};
    float center[3], half_side[3];
    for (uint k = 0; k < 3; ++k) {
        center[k] = from[k] * 0.5f + to[k] * 0.5f;
        half_side[k] = greater(absolute(from[k] - center[k]), absolute(to[k] - center[k]));
        column[k * 8] = center[k];
    }
    // Beyond the line from A to C is what lies on the side of D
    const float right = from[u] < to[u] ? 1.0f : -1.0f, up = from[v] < to[v] ? 1.0f : -1.0f;
    const float side = second[u] == from[u] ? 1.0f : -1.0f;
    column[24] = half_side[u] * (1.0f + 8.0f * EPSILON);
    column[32] = half_side[v] * (1.0f + 8.0f * EPSILON);
    column[40] = quotient(-side * right, half_side[u]);
    column[48] = quotient(side * up, half_side[v]);
    column[ANALYTIC_KIND] = as_float((ANALYTIC_RECTANGLE + axis) | BVH_NUMBER);
    column[ANALYTIC_ID] = as_float(unit | BVH_NUMBER);
}

// The column of a curve, from whose ends others go on as `joints` tells.
static void columns_put_curve(__global float* column, uint joints, uint number, __global const float* k) {
    for (uint i = 0; i < 3; ++i) {
        column[i * 8] = k[i];
        column[32 + i * 8] = k[4 + i] + (k[8 + i] + k[12 + i]);
    }
    column[24] = as_float(number | BVH_NUMBER);
    // u - u^2 is at most 1/4, and u - u^3 at most 0.385; the radius is at most that of a control point
    const float bend = square_root_one(fma(k[8], k[8], fma(k[9], k[9], k[10] * k[10]))) * 0.26f +
                       square_root_one(fma(k[12], k[12], fma(k[13], k[13], k[14] * k[14]))) * 0.4f;
    const float first = k[3] + k[7] * 0.333334f, second = k[3] + k[7] * 0.666667f + k[11] * 0.333334f, last = k[3] + (k[7] + (k[11] + k[15]));
    const float radius = max(max(fabs(k[3]), fabs(first)), max(fabs(second), fabs(last)));
    const uint reach = (as_uint(fma(radius, 1.01f, bend * 1.01f)) >> 5) + 1u;
    column[ANALYTIC_KIND] = as_float((ANALYTIC_CURVE + joints) | reach << ANALYTIC_CURVE_REACH | BVH_NUMBER);
}

// The column of a sphere, disk or curve, its number among them and as a primitive.
static void columns_put_round(__global float* column, AnalyticShape r, uint number, uint primitive, __global const float* curve_rows) {
    column[ANALYTIC_ID] = as_float(primitive | BVH_NUMBER);
    if (r.normal.w >= ANALYTIC_SHAPE_CURVE) {
        columns_put_curve(column, (uint)(r.normal.w - ANALYTIC_SHAPE_CURVE), number, curve_rows + (size_t)number * 16);
        return;
    }
    const int disk = r.normal.x != 0.0f || r.normal.y != 0.0f || r.normal.z != 0.0f;
    const float rows[7] = {r.center_radius.x, r.center_radius.y, r.center_radius.z, r.center_radius.w, r.normal.x, r.normal.y, r.normal.z};
    for (uint k = 0; k < 7; ++k) column[k * 8] = rows[k];
    column[ANALYTIC_KIND] = as_float((disk ? ANALYTIC_DISK : ANALYTIC_SPHERE) | BVH_NUMBER);
}

// What a column of a block holds: the number of a unit, or NONE.
__kernel void build_triangle_columns(__global const uint* columns, uint count, __global const uint* units,
                                     __global const float* vertices, __global const uint* triangles, __global float* packs) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    __global float* column = packs + (size_t)(i / 8u) * TRIANGLE_BLOCK_WORDS + i % 8u;
    if (columns[i] != NONE)
        columns_put_triangle(column, units[columns[i]], vertices, triangles);
    else
        for (uint k = 0; k < TRIANGLE_BLOCK_WORDS / 8; ++k) column[k * 8] = 0.0f;
    if (i + 1u == count) columns_end(packs + (size_t)(count / 8u) * TRIANGLE_BLOCK_WORDS);
}

__kernel void build_analytic_columns(__global const uint* columns, uint count, __global const uint* units,
                                     __global const uint* round_ones, uint triangle_units, uint triangle_count,
                                     __global const float* vertices, __global const uint* triangles,
                                     __global const AnalyticShape* analytic_shapes, __global const float* curve_rows,
                                     __global float* packs) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    __global float* column = packs + (size_t)(i / 8u) * ANALYTIC_BLOCK_WORDS + i % 8u;
    if (columns[i] == NONE) {
        for (uint k = 0; k < ANALYTIC_BLOCK_WORDS / 8; ++k) column[k * 8] = 0.0f;
    } else if (columns[i] < triangle_units) {
        columns_put_rectangle(column, units[columns[i]] & ~BVH_RECTANGLE, vertices, triangles);
    } else {
        const uint number = round_ones[columns[i] - triangle_units];
        columns_put_round(column, analytic_shapes[number], number, number + triangle_count, curve_rows);
    }
    if (i + 1u == count) columns_end(packs + (size_t)(count / 8u) * ANALYTIC_BLOCK_WORDS);
}

// The same of packs that exist, whose members are known by their numbers. boxes: of the triangle or pair of each column.
__kernel void refit_triangle_columns(uint count, __global const float* vertices, __global const uint* triangles, __global float* packs,
                                     __global float* boxes) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    __global float* column = packs + (size_t)(i / 8u) * TRIANGLE_BLOCK_WORDS + i % 8u;
    const uint number = as_uint(column[TRIANGLE_ID]), unit = number & ~BVH_NUMBER;
    if (!(number & BVH_NUMBER)) return;
    columns_put_triangle(column, unit, vertices, triangles);
    box_save(boxes, i, box_of_triangles(unit, vertices, triangles));
}

__kernel void refit_analytic_columns(uint count, uint triangle_count, __global const float* vertices, __global const uint* triangles,
                                     __global const AnalyticShape* analytic_shapes, __global const float* curve_rows,
                                     __global float* packs) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    __global float* column = packs + (size_t)(i / 8u) * ANALYTIC_BLOCK_WORDS + i % 8u;
    const uint number = as_uint(column[ANALYTIC_ID]), unit = number & ~BVH_NUMBER;
    if (!(number & BVH_NUMBER)) return;
    if (unit & BVH_PAIR)
        columns_put_rectangle(column, unit, vertices, triangles);
    else
        columns_put_round(column, analytic_shapes[unit - triangle_count], unit - triangle_count, unit, curve_rows);
}

static Box refit_box_of_node(__global const float* node) {
    Box b = box_empty();
    for (uint i = 0; i < 8; ++i) {
        if (as_uint(node[BVH_CHILD + i]) == BVH_EMPTY) continue;
        for (int k = 0; k < 3; ++k) {
            b.low[k] = lesser(b.low[k], node[BVH_LOW + k * 8 + i]);
            b.high[k] = greater(b.high[k], node[BVH_HIGH + k * 8 + i]);
        }
    }
    return b;
}

// The boxes of the children of nodes [first, first + count), whose own children have theirs. instance_boxes: of instances by their numbers.
__kernel void refit_nodes(uint first, uint count, uint triangle_count, __global const float* vertices, __global const uint* triangles,
                          __global const AnalyticShape* analytic_shapes, __global const float* instance_boxes,
                          __global const float* triangle_boxes, __global const float* analytic_packs, __global float* nodes) {
    const uint at = (uint)get_global_id(0);
    if (at >= count) return;
    __global float* node = nodes + (size_t)(first + at) * BVH_NODE_WORDS;
    for (uint i = 0; i < 8; ++i) {
        const uint reference = as_uint(node[BVH_CHILD + i]);
        if (reference == BVH_EMPTY) continue;
        Box b = box_empty();
        if (reference & BVH_LEAF) {
            const uint place = reference & BVH_INDEX, size = bvh_members(reference);
            for (uint m = place; m < place + size; ++m) {
                if (!(reference & BVH_ANALYTIC)) {
                    b = box_union(b, box_load(triangle_boxes, m));
                    continue;
                }
                const uint unit = as_uint(analytic_packs[(size_t)(m / 8u) * ANALYTIC_BLOCK_WORDS + ANALYTIC_ID + m % 8u]) & ~BVH_NUMBER;
                b = box_union(b, unit & BVH_PAIR ? box_of_triangles(unit, vertices, triangles) : box_of_round(analytic_shapes[unit - triangle_count]));
            }
        } else if (reference & BVH_INSTANCE) {
            b = box_load(instance_boxes, reference & ~BVH_INSTANCE);
        } else {
            b = refit_box_of_node(nodes + (size_t)reference * BVH_NODE_WORDS);
        }
        for (int k = 0; k < 3; ++k) {
            node[BVH_LOW + k * 8 + i] = b.low[k];
            node[BVH_HIGH + k * 8 + i] = b.high[k];
        }
    }
}

// What rays that meet a node have to do in it and its packs, but for a factor: the areas of its children's boxes.
__kernel void refit_costs(uint count, __global const float* nodes, __global float* costs) {
    const uint at = (uint)get_global_id(0);
    if (at >= count) return;
    __global const float* node = nodes + (size_t)at * BVH_NODE_WORDS;
    float cost = 0.0f;
    for (uint i = 0; i < 8; ++i) {
        if (as_uint(node[BVH_CHILD + i]) == BVH_EMPTY) continue;
        Box b;
        for (int k = 0; k < 3; ++k) b.low[k] = node[BVH_LOW + k * 8 + i], b.high[k] = node[BVH_HIGH + k * 8 + i];
        cost += cost_area(b);
    }
    costs[at] = cost;
}
