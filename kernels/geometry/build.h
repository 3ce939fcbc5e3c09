// What the kernels that build the tree share: boxes, and the binary tree that they make before the wide one.
#ifndef GEOMETRY_BUILD_H
#define GEOMETRY_BUILD_H

#include "geometry/bvh.h"
#include "geometry/wide.h"
#include "types.h"

// Work-items of the sort and the scans go through this many elements one after the other.
#define BUILD_CHUNK 1024u

// What stands in the tree are units: triangles and pairs of them as `build_units` lists them, then spheres and disks, of which
// `round_ones` are the numbers, then instances, of which `instances` are. A pair that is a rectangle square to an axis goes into the
// packs of spheres and disks; an instance is a leaf of its own.
//
// The binary tree: nodes [0, n) are the units in Morton order, the others follow as they are made. A node is eight words, half a cache line:
// low x, y, z and high x, y, z of its box, and its members: how many units, and of which kinds.
#define BINARY_WORDS 8
#define BINARY_MEMBERS 6
#define MEMBERS_COUNT 0x1fffffffu
#define MEMBERS_INSTANCE 0x20000000u
#define MEMBERS_TRIANGLE 0x40000000u
#define MEMBERS_ANALYTIC 0x80000000u

typedef struct {
    float low[3], high[3];
} Box;

// A corner of a triangle.
static vec3 build_vertex(__global const float* vertices, __global const uint* triangles, size_t corner) {
    const size_t v = (size_t)triangles[corner] * 3;
    return vec3_of(vertices[v], vertices[v + 1], vertices[v + 2]);
}

// The axis that a rectangle A B C D is square to, if it has sides along the other two, exactly: 0 to 2, else 3.
static uint build_rectangle_axis(vec3 a, vec3 b, vec3 c, vec3 d) {
    const float at[4][3] = {{a.x, a.y, a.z}, {b.x, b.y, b.z}, {c.x, c.y, c.z}, {d.x, d.y, d.z}};
    for (uint axis = 0; axis < 3; ++axis) {
        const uint u = (axis + 1) % 3, v = (axis + 2) % 3;
        if (at[0][axis] != at[1][axis] || at[0][axis] != at[2][axis] || at[0][axis] != at[3][axis]) continue;
        const int u_first = at[0][v] == at[1][v] && at[1][u] == at[2][u] && at[2][v] == at[3][v] && at[3][u] == at[0][u];
        const int v_first = at[0][u] == at[1][u] && at[1][v] == at[2][v] && at[2][u] == at[3][u] && at[3][v] == at[0][v];
        if (u_first || v_first) return axis;
    }
    return 3;
}

static Box box_at(__global const float* words) {
    Box b;
    for (int k = 0; k < 3; ++k) {
        b.low[k] = words[k];
        b.high[k] = words[3 + k];
    }
    return b;
}
static void box_put(__global float* words, Box b) {
    for (int k = 0; k < 3; ++k) {
        words[k] = b.low[k];
        words[3 + k] = b.high[k];
    }
}
static Box box_load(__global const float* boxes, size_t index) { return box_at(boxes + index * 6); }
static void box_save(__global float* boxes, size_t index, Box b) { box_put(boxes + index * 6, b); }

static Box binary_box(__global const float* tree, size_t node) { return box_at(tree + node * BINARY_WORDS); }
static uint binary_members(__global const float* tree, size_t node) { return as_uint(tree[node * BINARY_WORDS + BINARY_MEMBERS]); }
static void binary_save(__global float* tree, size_t node, Box box, uint members) {
    box_put(tree + node * BINARY_WORDS, box);
    tree[node * BINARY_WORDS + BINARY_MEMBERS] = as_float(members);
}
// Into a box of its own: rusticl (Mesa 22.3) lets what a function does to a struct that it was given by value reach the caller's.
static Box box_union(Box a, Box b) {
    Box both;
    for (int k = 0; k < 3; ++k) {
        both.low[k] = lesser(a.low[k], b.low[k]);
        both.high[k] = greater(a.high[k], b.high[k]);
    }
    return both;
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

// Half the extents of the box of a sphere, or of a disk with this unit normal. (Of 1 − n² along an axis little would be left where
// the disk is nearly square to it; the sum of the other squares keeps its digits.)
static void round_extents(float extent[3], float radius, float nx, float ny, float nz) {
    const float x2 = nx * nx, y2 = ny * ny, z2 = nz * nz;
    const int disk = x2 + y2 + z2 > 0.0f;
    extent[0] = radius * (disk ? square_root(y2 + z2) : 1.0f) * BOX_SLACK;
    extent[1] = radius * (disk ? square_root(x2 + z2) : 1.0f) * BOX_SLACK;
    extent[2] = radius * (disk ? square_root(x2 + y2) : 1.0f) * BOX_SLACK;
}

// Boxes are larger than what is in them by more than a rounding: a ray that lies in the face of a box is not told from one beside it, and the
// tests of spheres and disks let in what passes by that much. But an axis along which the primitive is flat stays flat, so that a ray
// leaving a wall does not enter the wall's box again.
static Box box_enlarged(Box box, const float extent[3], float slack) {
    Box b;
    for (int k = 0; k < 3; ++k) {
        b.low[k] = extent[k] == 0.0f ? box.low[k] : box.low[k] - greater(slack, absolute(box.low[k]) * (2.0f * EPSILON));
        b.high[k] = extent[k] == 0.0f ? box.high[k] : box.high[k] + greater(slack, absolute(box.high[k]) * (2.0f * EPSILON));
    }
    return b;
}

// The box of a triangle, or with BVH_PAIR of it and the next one.
static Box box_of_triangles(uint unit, __global const float* vertices, __global const uint* triangles) {
    const uint first = unit & ~BVH_PAIR, corners = unit & BVH_PAIR ? 6 : 3;
    Box b = box_empty();
    float slack = 0.0f, extent[3];
    for (uint corner = 0; corner < corners; ++corner) {
        const size_t v = (size_t)triangles[(size_t)first * 3 + corner] * 3;
        for (int k = 0; k < 3; ++k) {
            b.low[k] = lesser(b.low[k], vertices[v + k]);
            b.high[k] = greater(b.high[k], vertices[v + k]);
        }
    }
    for (int k = 0; k < 3; ++k) {
        extent[k] = b.high[k] - b.low[k];
        slack = greater(slack, extent[k] * (8.0f * EPSILON));
    }
    return box_enlarged(b, extent, slack);
}

// The box of a sphere, disk or curve.
static Box box_of_round(AnalyticShape r) {
    const float center[3] = {r.center_radius.x, r.center_radius.y, r.center_radius.z};
    float extent[3] = {r.normal.x, r.normal.y, r.normal.z};
    Box b;
    if (r.normal.w < ANALYTIC_SHAPE_CURVE) round_extents(extent, r.center_radius.w, r.normal.x, r.normal.y, r.normal.z);
    for (int k = 0; k < 3; ++k) {
        b.low[k] = center[k] - extent[k];
        b.high[k] = center[k] + extent[k];
    }
    return box_enlarged(b, extent, 0.0f);
}

#endif
