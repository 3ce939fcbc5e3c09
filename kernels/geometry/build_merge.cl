// The binary tree, bottom up: parallel locally-ordered clustering (Meister & Bittner, TVCG 24(3) 2018). Clusters stand in Morton
// order; each looks for the neighbour with which its box would be smallest, and pairs that chose each other become one. The tree's
// quality is near that of a full sweep by surface area, and nothing in it depends on timing.
#include "geometry/build_cost.h"

// How far along the order a cluster looks, to both sides: a multiple of eight.
#define MERGE_RADIUS 16
// How many clusters a work-item asks; their neighbours' boxes it has at hand.
#define MERGE_CHUNK 64

// Leaves of the binary tree, in Morton order.
__kernel void build_leaves(__global const float* boxes, __global const uint* order, __global const uint* units, uint triangle_units,
                           uint round_count, uint count, __global float* tree, __global uint* clusters) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    const uint unit = order[i];
    const Box box = box_load(boxes, unit);
    const int triangle = unit < triangle_units && !(units[unit] & BVH_RECTANGLE);
    const int instance = unit >= triangle_units + round_count;
    binary_save(tree, i, box, 1u | (triangle ? MEMBERS_TRIANGLE : instance ? MEMBERS_INSTANCE : MEMBERS_ANALYTIC));
    clusters[i] = i;
}

// Half the surface areas of the boxes that hold a cluster and eight of its neighbours; NEVER where there is no neighbour.
static float8 nearest_areas(const Box* own, const float side[6][MERGE_CHUNK + 2 * MERGE_RADIUS], uint first, int8 there) {
    float8 extent[3];
    #pragma unroll
    for (int k = 0; k < 3; ++k) {
        const float8 low = vload8(0, side[k] + first), high = vload8(0, side[3 + k] + first);
        extent[k] = (high > own->high[k] ? high : (float8)(own->high[k])) - (low < own->low[k] ? low : (float8)(own->low[k]));
    }
    const float8 area = fma(extent[0], extent[1], fma(extent[1], extent[2], extent[2] * extent[0]));
    return there ? (area < FAR ? area : (float8)(FAR)) : (float8)(NEVER);
}

static void nearest_choose(float8 other_area, uint8 other_pair, float8* area, uint8* pair) {
    const int8 better = (other_area < *area) | ((other_area == *area) & (other_pair < *pair));
    *area = better ? other_area : *area;
    *pair = better ? other_pair : *pair;
}

// The partner each cluster of the chunk from `first` on would choose. Equally good pairs are told apart by the exclusive or of their places,
// which is the same from both sides: so there is always a pair to join, and among equals neighbours pair off all at once.
static void nearest_of_chunk(__global const float* tree, __global const uint* clusters, uint count, uint first, __global uint* nearest) {
    const uint last = min(count, first + MERGE_CHUNK);
    float side[6][MERGE_CHUNK + 2 * MERGE_RADIUS];
    for (uint at = 0; at < MERGE_CHUNK + 2 * MERGE_RADIUS; ++at) {
        const uint i = min(max(first + at, (uint)MERGE_RADIUS) - MERGE_RADIUS, count - 1);
        const size_t box = (size_t)clusters[i] * BINARY_WORDS;
        for (int k = 0; k < 6; ++k) side[k][at] = tree[box + k];
    }
    const uint8 number = (uint8)(0, 1, 2, 3, 4, 5, 6, 7);
    for (uint i = first; i < last; ++i) {
        const uint at = i - first + MERGE_RADIUS;
        Box own;
        for (int k = 0; k < 3; ++k) own.low[k] = side[k][at], own.high[k] = side[3 + k][at];
        float8 area = (float8)(NEVER);
        uint8 pair = (uint8)(NONE);
        for (uint away = 0; away < MERGE_RADIUS; away += 8) {
            const uint8 before = i - MERGE_RADIUS + away + number, after = i + 1 + away + number;
            nearest_choose(nearest_areas(&own, side, at - MERGE_RADIUS + away, before < i), before ^ i, &area, &pair);
            nearest_choose(nearest_areas(&own, side, at + 1 + away, after < count), after ^ i, &area, &pair);
        }
        const float least = least_of_eight(area);
        const uint best = least_uint_of_eight(area == least ? pair : (uint8)(NONE));
        nearest[i] = least < NEVER ? i ^ best : NONE;
    }
}

__kernel void build_nearest(__global const float* tree, __global const uint* clusters, uint count, __global uint* nearest) {
    const uint first = (uint)get_global_id(0) * MERGE_CHUNK;
    if (first < count) nearest_of_chunk(tree, clusters, count, first, nearest);
}

static int merge_first(__global const uint* nearest, uint i) { return nearest[i] != NONE && nearest[nearest[i]] == i && i < nearest[i]; }
static int merge_second(__global const uint* nearest, uint i) { return nearest[i] != NONE && nearest[nearest[i]] == i && i > nearest[i]; }

// How many clusters each chunk keeps (the second of a pair goes), and how many pairs it has.
__kernel void build_merge_count(__global const uint* nearest, uint count, __global uint* kept, __global uint* pairs) {
    const uint chunk = (uint)get_global_id(0);
    const uint first = chunk * BUILD_CHUNK, last = min(count, first + BUILD_CHUNK);
    if (first >= count) return;
    uint keeps = 0, merges = 0;
    for (uint i = first; i < last; ++i) {
        keeps += merge_second(nearest, i) ? 0 : 1;
        merges += merge_first(nearest, i) ? 1 : 0;
    }
    kept[chunk] = keeps;
    pairs[chunk] = merges;
}

// Joins the pairs among the clusters from `first` to `last`, and writes those that are left from `to` on. Returns where these end. `node`: the
// first node that is made, and then the next one.
static uint merge_clusters(__global const uint* nearest, __global const uint* clusters, uint first, uint last, uint to, uint leaf_count,
                           uint* node, __global float* tree, __global uint2* children, __global float* costs, __global uint* merged) {
    for (uint i = first; i < last; ++i) {
        if (merge_second(nearest, i)) continue;
        uint cluster = clusters[i];
        if (merge_first(nearest, i)) {
            const uint2 pair = (uint2)(cluster, clusters[nearest[i]]);
            const Box box = box_union(binary_box(tree, pair.x), binary_box(tree, pair.y));
            const uint first = binary_members(tree, pair.x), second = binary_members(tree, pair.y);
            const uint below = ((first | second) & ~MEMBERS_COUNT) | ((first & MEMBERS_COUNT) + (second & MEMBERS_COUNT));
            binary_save(tree, *node, box, below);
            children[*node - leaf_count] = pair;
            cost_save_pair(tree, costs, leaf_count, *node, box, below, pair);
            cluster = (*node)++;
        }
        merged[to++] = cluster;
    }
    return to;
}

__kernel void build_merge(__global const uint* nearest, __global const uint* clusters, uint count, __global const uint* kept,
                          __global const uint* pairs, uint leaf_count, uint next_node, __global float* tree,
                          __global uint2* children, __global float* costs, __global uint* merged) {
    const uint chunk = (uint)get_global_id(0);
    const uint first = chunk * BUILD_CHUNK, last = min(count, first + BUILD_CHUNK);
    if (first >= count) return;
    uint node = next_node + pairs[chunk];
    merge_clusters(nearest, clusters, first, last, kept[chunk], leaf_count, &node, tree, children, costs, merged);
}

// All steps for few clusters, by one work-item: each launch, and each number that the host waits for, takes longer.
__kernel void build_merge_few(uint leaf_count, __global uint* clusters, __global uint* merged, __global uint* nearest, __global float* tree,
                              __global uint2* children, __global float* costs) {
    if (get_global_id(0) > 0) return;
    __global uint* from = clusters;
    __global uint* to = merged;
    uint count = leaf_count, node = leaf_count;
    while (count > 1) {
        for (uint first = 0; first < count; first += MERGE_CHUNK) nearest_of_chunk(tree, from, count, first, nearest);
        count = merge_clusters(nearest, from, 0u, count, 0u, leaf_count, &node, tree, children, costs, to);
        __global uint* const other = from;
        from = to, to = other;
    }
}
