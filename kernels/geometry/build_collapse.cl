// From the binary tree to the wide one of geometry/bvh.h, level by level from the root, the way that costs least.
#include "geometry/build_cost.h"

// The roots of the eight trees, or fewer, that are below a node. Returns how many.
static uint collapse_children(__global const uint2* children, __global const float* costs, uint node, uint child[8]) {
    uint open[8], roots[8];
    uint top = 0, count = 0;
    open[0] = node, roots[0] = 8;
    for (;;) {
        const uint2 pair = children[open[top]];
        const uint shared = roots[top];
        uint firsts;
        cost_of_pair(costs, pair, shared, &firsts);
        open[top] = pair.y, roots[top] = shared - firsts;
        ++top;
        open[top] = pair.x, roots[top] = firsts;
        // Trees that stay whole, and more trees allowed than are of use
        for (;;) {
            while (roots[top] > 1 && cost_of(costs, open[top], roots[top]) == cost_of(costs, open[top], roots[top] - 1)) --roots[top];
            if (roots[top] > 1) break;
            child[count++] = open[top];
            if (top-- == 0) return count;
        }
    }
}

// Each task is a binary node that becomes a wide one: its children, and how many of them are nodes, packs of triangles, of rounds.
__kernel void build_collapse_count(__global const uint* members, __global const uint2* children, __global const float* costs,
                                   __global const uint* tasks, uint task_count, __global uint* slots, __global uint* inner,
                                   __global uint* triangle_packs, __global uint* round_packs) {
    const uint task = (uint)get_global_id(0);
    if (task >= task_count) return;
    uint child[8];
    uint count = 1;
    child[0] = tasks[task];
    // Only the root of a scene that fits into one pack
    if (!cost_fits_leaf(members[child[0]])) count = collapse_children(children, costs, tasks[task], child);
    uint inners = 0, triangles = 0, rounds = 0;
    for (uint i = 0; i < 8; ++i) {
        const uint node = i < count ? child[i] : NONE;
        slots[(size_t)task * 8 + i] = node;
        if (node == NONE) continue;
        if (!cost_fits_leaf(members[node])) ++inners;
        else if (members[node] & MEMBERS_TRIANGLE) ++triangles;
        else ++rounds;
    }
    inner[task] = inners;
    triangle_packs[task] = triangles;
    round_packs[task] = rounds;
}

// The tasks of the next level, where nothing else is wanted of this one.
__kernel void build_next_tasks(__global const uint* members, __global const uint* slots, uint task_count,
                               __global const uint* inner, __global uint* next_tasks) {
    const uint task = (uint)get_global_id(0);
    if (task >= task_count) return;
    uint next = inner[task];
    for (uint i = 0; i < 8; ++i) {
        const uint child = slots[(size_t)task * 8 + i];
        if (child != NONE && !cost_fits_leaf(members[child])) next_tasks[next++] = child;
    }
}

// The units below a node that becomes a leaf, in order.
static uint collapse_units(__global const uint2* children, __global const uint* order, uint leaf_count, uint node,
                           uint units[8]) {
    uint stack[8];
    uint top = 0, count = 0;
    stack[top++] = node;
    while (top > 0) {
        const uint at = stack[--top];
        if (at < leaf_count) {
            units[count++] = order[at];
        } else {
            stack[top++] = children[at].y;
            stack[top++] = children[at].x;
        }
    }
    return count;
}

static void collapse_triangle_pack(__global float* pack, const uint members[8], uint count, __global const uint* units,
                                   __global const float* vertices, __global const uint* triangles) {
    for (uint i = 0; i < 8; ++i) {
        const uint unit = i < count ? units[members[i]] : NONE;
        vec3 corner[6];
        for (uint k = 0; k < 6; ++k) corner[k] = vec3_all(0.0f);
        const int pair = i < count && (unit & BVH_PAIR);
        for (uint k = 0; k < (i < count ? (pair ? 6u : 3u) : 0u); ++k)
            corner[k] = build_vertex(vertices, triangles, (size_t)(unit & ~BVH_PAIR) * 3 + k);
        Triangle t = triangle_of(corner[0], corner[1], corner[2]);
        if (pair) t = triangle_pair_of(corner[0], corner[1], corner[2], corner[5]);
        const vec3 rows[4] = {t.a, t.ab, t.ca, t.normal};
        for (uint k = 0; k < 4; ++k) pack[k * 24 + i] = rows[k].x, pack[k * 24 + 8 + i] = rows[k].y, pack[k * 24 + 16 + i] = rows[k].z;
        pack[96 + i] = t.size;
        pack[104 + i] = t.unsure;
        pack[112 + i] = t.diagonal;
        pack[TRIANGLE_PACK_ID + i] = as_float(unit);
    }
}

static void collapse_round_pack(__global float* pack, const uint members[8], uint count, __global const Round* rounds,
                                uint triangle_units, uint triangle_count) {
    for (uint i = 0; i < 8; ++i) {
        Round r = {(float4)(0.0f, 0.0f, 0.0f, 0.0f), (float4)(0.0f, 0.0f, 0.0f, 0.0f)};
        const uint number = i < count ? members[i] - triangle_units : NONE;
        if (i < count) r = rounds[number];
        pack[i] = r.center_radius.x, pack[8 + i] = r.center_radius.y, pack[16 + i] = r.center_radius.z;
        pack[24 + i] = r.center_radius.w;
        pack[32 + i] = r.normal.x, pack[40 + i] = r.normal.y, pack[48 + i] = r.normal.z;
        pack[ROUND_PACK_ID + i] = as_float(i < count ? number + triangle_count : NONE);
    }
}

// Writes the nodes and packs of a level and the tasks of the next. `first_*`: how many of each exist from earlier levels.
__kernel void build_collapse(__global const float* node_boxes, __global const uint* members, __global const uint2* children,
                             __global const uint* order, uint leaf_count, __global const uint* slots, uint task_count,
                             __global const uint* inner, __global const uint* triangle_offsets, __global const uint* round_offsets,
                             uint first_node, uint first_triangle_pack, uint first_round_pack, __global const uint* units,
                             __global const float* vertices, __global const uint* triangles, __global const Round* rounds,
                             uint triangle_units, uint triangle_count,
                             __global float* nodes, __global float* triangle_packs, __global float* round_packs,
                             __global uint* next_tasks) {
    const uint task = (uint)get_global_id(0);
    if (task >= task_count) return;
    __global float* node = nodes + (size_t)(first_node + task) * BVH_NODE_WORDS;
    uint next = inner[task];
    uint triangle_pack = first_triangle_pack + triangle_offsets[task], round_pack = first_round_pack + round_offsets[task];
    for (uint i = 0; i < 8; ++i) {
        const uint child = slots[(size_t)task * 8 + i];
        uint reference = BVH_EMPTY;
        Box b = box_empty();
        if (child != NONE) {
            b = box_load(node_boxes, child);
            uint held[8];
            if (!cost_fits_leaf(members[child])) {
                reference = first_node + task_count + next;
                next_tasks[next++] = child;
            } else {
                const uint count = collapse_units(children, order, leaf_count, child, held);
                if (members[child] & MEMBERS_TRIANGLE) {
                    collapse_triangle_pack(triangle_packs + (size_t)triangle_pack * TRIANGLE_PACK_WORDS, held, count, units,
                                           vertices, triangles);
                    reference = BVH_LEAF | triangle_pack++;
                } else {
                    collapse_round_pack(round_packs + (size_t)round_pack * ROUND_PACK_WORDS, held, count, rounds,
                                        triangle_units, triangle_count);
                    reference = BVH_LEAF | BVH_ROUND | round_pack++;
                }
            }
        }
        for (int k = 0; k < 3; ++k) {
            node[BVH_LOW + k * 8 + i] = b.low[k];
            node[BVH_HIGH + k * 8 + i] = b.high[k];
        }
        node[BVH_CHILD + i] = as_float(reference);
    }
}
