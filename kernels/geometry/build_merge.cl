// The binary tree, bottom up: parallel locally-ordered clustering (Meister & Bittner, TVCG 24(3) 2018). Clusters stand in Morton
// order; each looks for the neighbour with which its box would be smallest, and pairs that chose each other become one. The tree's
// quality is near that of a full sweep by surface area, and nothing in it depends on timing.
#include "geometry/build.h"

// How far along the order a cluster looks, to both sides.
#define MERGE_RADIUS 16

// Leaves of the binary tree, in Morton order.
__kernel void build_leaves(__global const float* boxes, __global const uint* order, uint triangle_units, uint count,
                           __global float* node_boxes, __global uint* members, __global uint* clusters) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    const uint unit = order[i];
    box_save(node_boxes, i, box_load(boxes, unit));
    members[i] = 1u | (unit < triangle_units ? MEMBERS_TRIANGLE : MEMBERS_ROUND);
    clusters[i] = i;
}

// The partner each cluster would choose. Equally good pairs are told apart by the exclusive or of their places, which is the same
// from both sides: so there is always a pair to join, and among equals neighbours pair off all at once.
__kernel void build_nearest(__global const float* node_boxes, __global const uint* clusters, uint count, __global uint* nearest) {
    const uint i = (uint)get_global_id(0);
    if (i >= count) return;
    const Box own = box_load(node_boxes, clusters[i]);
    const uint first = i > MERGE_RADIUS ? i - MERGE_RADIUS : 0, last = min(count - 1, i + MERGE_RADIUS);
    float best_area = FAR;
    uint best = NONE;
    for (uint j = first; j <= last; ++j) {
        if (j == i) continue;
        const float area = box_area(box_union(own, box_load(node_boxes, clusters[j])));
        const float bounded_area = area < FAR ? area : FAR;
        if (best == NONE || bounded_area < best_area || (bounded_area == best_area && (i ^ j) < (i ^ best))) {
            best_area = bounded_area;
            best = j;
        }
    }
    nearest[i] = best;
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

__kernel void build_merge(__global const uint* nearest, __global const uint* clusters, uint count, __global const uint* kept,
                          __global const uint* pairs, uint next_node, __global float* node_boxes, __global uint* members,
                          __global uint2* children, __global uint* merged) {
    const uint chunk = (uint)get_global_id(0);
    const uint first = chunk * BUILD_CHUNK, last = min(count, first + BUILD_CHUNK);
    if (first >= count) return;
    uint to = kept[chunk], node = next_node + pairs[chunk];
    for (uint i = first; i < last; ++i) {
        if (merge_second(nearest, i)) continue;
        uint cluster = clusters[i];
        if (merge_first(nearest, i)) {
            const uint other = clusters[nearest[i]];
            box_save(node_boxes, node, box_union(box_load(node_boxes, cluster), box_load(node_boxes, other)));
            members[node] = ((members[cluster] | members[other]) & ~MEMBERS_COUNT) |
                            ((members[cluster] & MEMBERS_COUNT) + (members[other] & MEMBERS_COUNT));
            children[node] = (uint2)(cluster, other);
            cluster = node++;
        }
        merged[to++] = cluster;
    }
}
