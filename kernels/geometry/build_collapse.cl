// From the binary tree to the wide one of geometry/bvh.h, level by level from the root, the way that costs least.
#include "geometry/build_cost.h"

// The roots of so many trees below a node, two to eight, or fewer. Returns how many.
static uint collapse_children(__global const float* tree, __global const uint2* children, __global const float* costs, uint leaf_count,
                              uint node, uint most, uint child[8]) {
    uint open[8], roots[8];
    float cost[2][COST_ROOTS];
    uint top = 0, count = 0;
    open[0] = node, roots[0] = most;
    for (;;) {
        const uint2 pair = children[open[top] - leaf_count];
        const uint shared = roots[top];
        uint firsts;
        cost_load(tree, costs, leaf_count, pair.x, cost[0]);
        cost_load(tree, costs, leaf_count, pair.y, cost[1]);
        cost_of_pair(cost[0], cost[1], shared, &firsts);
        open[top] = pair.y, roots[top] = shared - firsts;
        ++top;
        open[top] = pair.x, roots[top] = firsts;
        // Trees that stay whole, and more trees allowed than are of use
        for (;;) {
            cost_load(tree, costs, leaf_count, open[top], cost[0]);
            while (roots[top] > 1 && cost[0][roots[top] - 1] == cost[0][roots[top] - 2]) --roots[top];
            if (roots[top] > 1) break;
            child[count++] = open[top];
            if (top-- == 0) return count;
        }
    }
}

// A child of a wide node: a node of the binary tree, or several that are a pack together.
typedef struct {
    uint nodes[8], count;
    uint members;
    Box box;
} Child;

// A pack for each of two children, or one for both: what costs less, where lanes go together? Of sixteen rays that cross the scene at
// random one at least enters a box of this area with this chance; then they are tested with the box and each of its members.
static float collapse_cost(Box box, uint members, float scene_area) {
    const float misses = greater(1.0f - quotient(cost_area(box), scene_area), 0.0f);
    const float misses2 = misses * misses, misses4 = misses2 * misses2, misses8 = misses4 * misses4;
    const float test = members & MEMBERS_ANALYTIC ? 0.5f : 1.0f;
    return fma(-misses8, misses8, 1.0f) * fma((float)(members & MEMBERS_COUNT), test, 1.2f);
}

// What is saved if two children become one pack; not above zero where they had better not, or cannot.
static float collapse_gain(const Child* a, const Child* b, float scene_area) {
    const uint together = a->members + (b->members & MEMBERS_COUNT);
    if ((a->members ^ b->members) & ~MEMBERS_COUNT || !cost_fits_leaf(together)) return 0.0f;
    const float apart = collapse_cost(a->box, a->members, scene_area) + collapse_cost(b->box, b->members, scene_area);
    return apart - collapse_cost(box_union(a->box, b->box), together, scene_area);
}

static void collapse_join(Child* a, const Child* b) {
    for (uint k = 0; k < b->count; ++k) a->nodes[a->count++] = b->nodes[k];
    a->members += b->members & MEMBERS_COUNT;
    a->box = box_union(a->box, b->box);
}

// Join packs among the children as long as that saves anything. Returns how many children there are then.
static uint collapse_join_packs(Child child[8], uint count, float scene_area) {
    for (;;) {
        float most = 0.0f;
        uint first = 0, second = 0;
        for (uint a = 0; a < count; ++a) {
            for (uint b = a + 1; b < count; ++b) {
                const float gain = collapse_gain(&child[a], &child[b], scene_area);
                if (gain > most) most = gain, first = a, second = b;
            }
        }
        if (!(most > 0.0f)) return count;
        collapse_join(&child[first], &child[second]);
        --count;
        for (uint i = second; i < count; ++i) child[i] = child[i + 1];
    }
}

// Of the children that are nodes the largest that may fit as packs into the places that are left and its own, or `count`. Of a mesh one box
// tells most lanes that they have nothing to do there, but of a few things in a room it tells nobody.
static uint collapse_opens(const Child child[8], uint count) {
    float area = -1.0f;
    uint opens = count;
    for (uint i = 0; i < count; ++i) {
        const int small = !cost_fits_leaf(child[i].members) && (child[i].members & MEMBERS_COUNT) <= 8u * (9u - count);
        if (small && cost_area(child[i].box) > area) area = cost_area(child[i].box), opens = i;
    }
    return opens;
}

// The children of a wide node in the place of a binary one: as they cost least, with packs joined that do better together; and where that
// leaves room, what is in a small node in its place.
static uint collapse_node(__global const float* tree, __global const uint2* children,
                          __global const float* costs, uint leaf_count, uint node, float scene_area, Child child[8]) {
    uint found[8];
    uint count = 1, place = 0, some = 1;
    found[0] = node;
    // Only the root of a scene may fit into one pack
    if (!cost_fits_leaf(binary_members(tree, node))) some = collapse_children(tree, children, costs, leaf_count, node, 8, found);
    for (;;) {
        for (uint i = 0; i < some; ++i) {
            Child* one = &child[i == 0 ? place : count++];
            one->nodes[0] = found[i], one->count = 1;
            one->members = binary_members(tree, found[i]);
            one->box = binary_box(tree, found[i]);
        }
        count = collapse_join_packs(child, count, scene_area);
        place = collapse_opens(child, count);
        if (count == 8 || place == count) return count;
        some = collapse_children(tree, children, costs, leaf_count, child[place].nodes[0], 9 - count, found);
    }
}

// Where in blocks of their own the packs of one kind among the children go: the largest first, each into the first block that has
// room. Returns how many blocks. `places` of other children stay as they are.
static uint collapse_places(const Child child[8], uint count, uint kind, uint places[8]) {
    uint taken[8];
    uint blocks = 0;
    for (uint size = 8; size > 0; --size) {
        for (uint i = 0; i < count; ++i) {
            if (child[i].members != (kind | size)) continue;
            uint block = 0;
            while (block < blocks && taken[block] + size > 8) ++block;
            if (block == blocks) taken[blocks++] = 0;
            places[i] = block * 8 + taken[block];
            taken[block] += size;
        }
    }
    return blocks;
}

// The binary tree and its root, and binary nodes that become wide ones.
#define COLLAPSE_PARAMETERS                                                                                                 \
    __global const float *tree, __global const uint2 *children, __global const float *costs, \
        uint leaf_count, uint root, __global const uint *tasks, uint task_count
#define COLLAPSE_CHILDREN(child)                                                                                            \
    collapse_node(tree, children, costs, leaf_count, tasks[task], cost_area(binary_box(tree, root)), child)

// Of each task: how many of its children are nodes, and how many blocks the packs of triangles and of the others among them take.
__kernel void build_collapse_count(COLLAPSE_PARAMETERS, __global uint* inner, __global uint* triangle_blocks,
                                   __global uint* analytic_blocks) {
    const uint task = (uint)get_global_id(0);
    if (task >= task_count) return;
    Child child[8];
    uint inners = 0, places[8];
    const uint count = COLLAPSE_CHILDREN(child);
    for (uint i = 0; i < count; ++i) inners += cost_fits_leaf(child[i].members) ? 0 : 1;
    inner[task] = inners;
    triangle_blocks[task] = collapse_places(child, count, MEMBERS_TRIANGLE, places);
    analytic_blocks[task] = collapse_places(child, count, MEMBERS_ANALYTIC, places);
}

// The tasks of the next level. `inner`: sums of the above.
__kernel void build_next_tasks(COLLAPSE_PARAMETERS, __global const uint* inner, __global uint* next_tasks) {
    const uint task = (uint)get_global_id(0);
    if (task >= task_count) return;
    Child child[8];
    uint next = inner[task];
    const uint count = COLLAPSE_CHILDREN(child);
    for (uint i = 0; i < count; ++i)
        if (!cost_fits_leaf(child[i].members)) next_tasks[next++] = child[i].nodes[0];
}

// Writes the units below the nodes that become a pack, in order, and returns how many there are.
static uint collapse_units(__global const uint2* children, __global const uint* order, uint leaf_count, const Child* child,
                           __global uint* columns) {
    uint count = 0;
    for (uint k = 0; k < child->count; ++k) {
        uint stack[8];
        uint top = 0;
        stack[top++] = child->nodes[k];
        while (top > 0) {
            const uint at = stack[--top];
            if (at < leaf_count) {
                columns[count++] = order[at];
            } else {
                stack[top++] = children[at - leaf_count].y;
                stack[top++] = children[at - leaf_count].x;
            }
        }
    }
    return count;
}

static void collapse_put(__global float* node, uint place, Box b, uint reference) {
    for (int k = 0; k < 3; ++k) {
        node[BVH_LOW + k * 8 + place] = b.low[k];
        node[BVH_HIGH + k * 8 + place] = b.high[k];
    }
    node[BVH_CHILD + place] = as_float(reference);
}

// Writes the nodes of a level, and what the columns of its packs hold. `first_*`: how many of each exist from earlier levels.
//
// The children's places are one array and units are written where they belong: an array of units beside two of places shared memory with
// one of these in what NVIDIA's compiler made of it (driver 580).
__kernel void build_collapse(COLLAPSE_PARAMETERS, __global const uint* inner, __global const uint* triangle_offsets,
                             __global const uint* analytic_offsets, __global const uint* order, __global const uint* instances,
                             uint primitive_units, uint first_node,
                             uint first_triangle_block, uint first_analytic_block, __global float* nodes,
                             __global uint* triangle_columns, __global uint* analytic_columns) {
    const uint task = (uint)get_global_id(0);
    if (task >= task_count) return;
    __global float* node = nodes + (size_t)(first_node + task) * BVH_NODE_WORDS;
    Child child[8];
    uint next = inner[task], places[8];
    const uint count = COLLAPSE_CHILDREN(child);
    const uint first_triangle = (first_triangle_block + triangle_offsets[task]) * 8;
    const uint first_analytic = (first_analytic_block + analytic_offsets[task]) * 8;
    const uint triangle_blocks = collapse_places(child, count, MEMBERS_TRIANGLE, places);
    const uint analytic_blocks = collapse_places(child, count, MEMBERS_ANALYTIC, places);
    for (uint k = 0; k < triangle_blocks * 8; ++k) triangle_columns[first_triangle + k] = NONE;
    for (uint k = 0; k < analytic_blocks * 8; ++k) analytic_columns[first_analytic + k] = NONE;
    for (uint i = 0; i < 8; ++i) {
        uint reference = BVH_EMPTY;
        Box b = box_empty();
        if (i < count) b = child[i].box;
        if (i < count && !cost_fits_leaf(child[i].members)) {
            reference = first_node + task_count + next++;
        } else if (i < count && child[i].members & MEMBERS_INSTANCE) {
            reference = BVH_INSTANCE | instances[order[child[i].nodes[0]] - primitive_units];
        } else if (i < count) {
            const int analytic = (child[i].members & MEMBERS_ANALYTIC) != 0;
            const uint place = (analytic ? first_analytic : first_triangle) + places[i];
            const uint size = collapse_units(children, order, leaf_count, &child[i], (analytic ? analytic_columns : triangle_columns) + place);
            reference = BVH_LEAF | (analytic ? BVH_ANALYTIC : 0u) | (size - 1u) << BVH_COUNT | place;
        }
        collapse_put(node, i, b, reference);
    }
}

// A tree's nodes, from the first on, into another array. References count from an array's beginning, so they change by as much as the tree's
// first node and its first blocks do, modulo 2^32.
__kernel void build_append(__global const float* nodes, uint first, uint count, uint there_first, uint triangle_blocks, uint analytic_blocks,
                           __global float* to) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    __global const float* node = nodes + (size_t)(first + i) * BVH_NODE_WORDS;
    __global float* there = to + (size_t)(there_first + i) * BVH_NODE_WORDS;
    for (uint k = 0; k < BVH_CHILD; ++k) there[k] = node[k];
    for (uint k = BVH_CHILD; k < BVH_NODE_WORDS; ++k) {
        uint reference = as_uint(node[k]);
        const int leaf = (reference & BVH_LEAF) != 0, instance = !leaf && (reference & BVH_INSTANCE) != 0;
        const uint blocks = reference & BVH_ANALYTIC ? analytic_blocks : triangle_blocks;
        if (reference != BVH_EMPTY && !instance) reference += leaf ? 8u * blocks : there_first - first;
        there[k] = as_float(reference);
    }
}

// Blocks of packs likewise, word by word; first and there_first count eight words. What is added to the numbers of pairs of triangles, and
// to those of others, is where their primitives are now less where they were.
__kernel void build_copy(__global const float* words, uint first, uint count, uint there_first, uint block_words, uint numbers, uint of_pairs,
                         uint of_others, __global float* to) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    uint word = as_uint(words[(size_t)first * 8u + i]);
    if (i % block_words / 8u == numbers / 8u && (word & BVH_NUMBER)) word += word & BVH_PAIR ? of_pairs : of_others;
    to[(size_t)there_first * 8u + i] = as_float(word);
}
