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

// Where in blocks of their own the packs of one kind among the children go: the largest first, each into the first block that has
// room. Returns how many blocks. With NONE a child is something else.
static uint collapse_places(__global const uint* members, const uint child[8], uint count, uint kind, uint places[8]) {
    uint taken[8];
    uint blocks = 0;
    for (uint i = 0; i < count; ++i) places[i] = NONE;
    for (uint size = 8; size > 0; --size) {
        for (uint i = 0; i < count; ++i) {
            if (members[child[i]] != (kind | size)) continue;
            uint block = 0;
            while (block < blocks && taken[block] + size > 8) ++block;
            if (block == blocks) taken[blocks++] = 0;
            places[i] = block * 8 + taken[block];
            taken[block] += size;
        }
    }
    return blocks;
}

// Each task is a binary node that becomes a wide one: its children, and how many of them are nodes, and how many blocks the packs of
// triangles and of rounds among them take.
__kernel void build_collapse_count(__global const uint* members, __global const uint2* children, __global const float* costs,
                                   __global const uint* tasks, uint task_count, __global uint* slots, __global uint* inner,
                                   __global uint* triangle_blocks, __global uint* round_blocks) {
    const uint task = (uint)get_global_id(0);
    if (task >= task_count) return;
    uint child[8];
    uint count = 1;
    child[0] = tasks[task];
    // Only the root of a scene that fits into one pack
    if (!cost_fits_leaf(members[child[0]])) count = collapse_children(children, costs, tasks[task], child);
    uint inners = 0, places[8];
    for (uint i = 0; i < 8; ++i) {
        slots[(size_t)task * 8 + i] = i < count ? child[i] : NONE;
        if (i < count && !cost_fits_leaf(members[child[i]])) ++inners;
    }
    inner[task] = inners;
    triangle_blocks[task] = collapse_places(members, child, count, MEMBERS_TRIANGLE, places);
    round_blocks[task] = collapse_places(members, child, count, MEMBERS_ROUND, places);
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

// Writes the nodes of a level, what the columns of its packs hold, and the tasks of the next level. `first_*`: how many of each exist from
// earlier levels.
__kernel void build_collapse(__global const float* node_boxes, __global const uint* members, __global const uint2* children,
                             __global const uint* order, uint leaf_count, __global const uint* slots, uint task_count,
                             __global const uint* inner, __global const uint* triangle_offsets, __global const uint* round_offsets,
                             uint first_node, uint first_triangle_block, uint first_round_block, __global float* nodes,
                             __global uint* triangle_columns, __global uint* round_columns, __global uint* next_tasks) {
    const uint task = (uint)get_global_id(0);
    if (task >= task_count) return;
    __global float* node = nodes + (size_t)(first_node + task) * BVH_NODE_WORDS;
    uint next = inner[task], count = 0, child[8], triangle_places[8], round_places[8];
    for (; count < 8 && slots[(size_t)task * 8 + count] != NONE; ++count) child[count] = slots[(size_t)task * 8 + count];
    const uint first_triangle = (first_triangle_block + triangle_offsets[task]) * 8;
    const uint first_round = (first_round_block + round_offsets[task]) * 8;
    const uint triangle_blocks = collapse_places(members, child, count, MEMBERS_TRIANGLE, triangle_places);
    const uint round_blocks = collapse_places(members, child, count, MEMBERS_ROUND, round_places);
    for (uint k = 0; k < triangle_blocks * 8; ++k) triangle_columns[first_triangle + k] = NONE;
    for (uint k = 0; k < round_blocks * 8; ++k) round_columns[first_round + k] = NONE;
    for (uint i = 0; i < 8; ++i) {
        uint reference = BVH_EMPTY;
        const Box b = i < count ? box_load(node_boxes, child[i]) : box_empty();
        if (i < count && !cost_fits_leaf(members[child[i]])) {
            reference = first_node + task_count + next;
            next_tasks[next++] = child[i];
        } else if (i < count) {
            uint units[8];
            const uint size = collapse_units(children, order, leaf_count, child[i], units);
            const int round = triangle_places[i] == NONE;
            const uint place = round ? first_round + round_places[i] : first_triangle + triangle_places[i];
            for (uint k = 0; k < size; ++k) (round ? round_columns : triangle_columns)[place + k] = units[k];
            reference = BVH_LEAF | (round ? BVH_ROUND : 0u) | (size - 1u) << BVH_COUNT | place;
        }
        for (int k = 0; k < 3; ++k) {
            node[BVH_LOW + k * 8 + i] = b.low[k];
            node[BVH_HIGH + k * 8 + i] = b.high[k];
        }
        node[BVH_CHILD + i] = as_float(reference);
    }
}

// What a column of a block holds: the number of a unit, or NONE.
__kernel void build_triangle_columns(__global const uint* columns, uint count, __global const uint* units,
                                     __global const float* vertices, __global const uint* triangles, __global float* packs) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    __global float* column = packs + (size_t)(i / 8u) * TRIANGLE_BLOCK_WORDS + i % 8u;
    const uint unit = columns[i] == NONE ? NONE : units[columns[i]];
    float rows[TRIANGLE_BLOCK_WORDS / 8] = {0.0f};
    if (unit != NONE) {
        vec3 corner[6];
        for (uint k = 0; k < (unit & BVH_PAIR ? 6u : 3u); ++k)
            corner[k] = build_vertex(vertices, triangles, (size_t)(unit & ~BVH_PAIR) * 3 + k);
        Triangle t = triangle_of(corner[0], corner[1], corner[2]);
        if (unit & BVH_PAIR) t = triangle_pair_of(corner[0], corner[1], corner[2], corner[5]);
        const vec3 vectors[4] = {t.a, t.ab, t.ca, t.normal};
        for (uint k = 0; k < 4; ++k) rows[k * 3] = vectors[k].x, rows[k * 3 + 1] = vectors[k].y, rows[k * 3 + 2] = vectors[k].z;
        rows[12] = t.size, rows[13] = t.unsure, rows[14] = t.diagonal;
        rows[TRIANGLE_ID / 8] = as_float(unit | BVH_NUMBER);
    }
    for (uint k = 0; k < TRIANGLE_BLOCK_WORDS / 8; ++k) column[k * 8] = rows[k];
}

__kernel void build_round_columns(__global const uint* columns, uint count, uint triangle_units, uint triangle_count,
                                  __global const Round* rounds, __global float* packs) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    __global float* column = packs + (size_t)(i / 8u) * ROUND_BLOCK_WORDS + i % 8u;
    float rows[ROUND_BLOCK_WORDS / 8] = {0.0f};
    if (columns[i] != NONE) {
        const uint number = columns[i] - triangle_units;
        const Round r = rounds[number];
        rows[0] = r.center_radius.x, rows[1] = r.center_radius.y, rows[2] = r.center_radius.z, rows[3] = r.center_radius.w;
        rows[4] = r.normal.x, rows[5] = r.normal.y, rows[6] = r.normal.z;
        rows[ROUND_ID / 8] = as_float((number + triangle_count) | BVH_NUMBER);
    }
    for (uint k = 0; k < ROUND_BLOCK_WORDS / 8; ++k) column[k * 8] = rows[k];
}
