// What a ray has to do below a node of the binary tree, once it is collapsed into wide nodes: the chance that it comes there, which is
// the area of the box, times one step for a node or a pack alike (surface area heuristic; Ylitie, Karras & Laine 2017 for the
// cheapest way to collapse, which is found from the bottom up).
//
// `costs` holds COST_ROOTS numbers a node, but for leaves: the least cost of what is below it, as a forest of at most 1, 2, … 7 trees.
#ifndef GEOMETRY_BUILD_COST_H
#define GEOMETRY_BUILD_COST_H

#include "geometry/build.h"

#define COST_ROOTS 7

static float cost_area(Box box) {
    const float area = box_area(box);
    return area < FAR ? area : FAR;
}

// Whether the units below a node fit into a pack, or are one instance: then they are a leaf, where the node is a tree of its own.
static int cost_fits_leaf(uint members) {
    const uint kinds = members & ~MEMBERS_COUNT;
    const uint most = kinds == MEMBERS_INSTANCE ? 1u : 8u;
    return (members & MEMBERS_COUNT) <= most && (kinds == MEMBERS_TRIANGLE || kinds == MEMBERS_ANALYTIC || kinds == MEMBERS_INSTANCE);
}

// The costs of a node. A single unit is a leaf, whatever is asked: what it costs is not kept, but known from its box.
static void cost_load(__global const float* tree, __global const float* costs, uint leaf_count, uint node, float cost[COST_ROOTS]) {
    if (node < leaf_count) {
        const float area = cost_area(binary_box(tree, node));
        for (uint i = 0; i < COST_ROOTS; ++i) cost[i] = area;
    } else {
        for (uint i = 0; i < COST_ROOTS; ++i) cost[i] = costs[(size_t)(node - leaf_count) * COST_ROOTS + i];
    }
}

// The least cost of a pair of subtrees as so many trees together, and how many of them are the first one's.
static float cost_of_pair(const float a[COST_ROOTS], const float b[COST_ROOTS], uint roots, uint* firsts) {
    float least = NEVER;
    *firsts = 1;
    for (uint first = 1; first < roots; ++first) {
        const float cost = a[first - 1] + b[roots - first - 1];
        if (cost < least) least = cost, *firsts = first;
    }
    return least;
}

static void cost_save_pair(__global const float* tree, __global float* costs, uint leaf_count, uint node, Box box, uint members, uint2 pair) {
    __global float* to = costs + (size_t)(node - leaf_count) * COST_ROOTS;
    const float area = cost_area(box);
    float a[COST_ROOTS], b[COST_ROOTS];
    uint firsts;
    cost_load(tree, costs, leaf_count, pair.x, a);
    cost_load(tree, costs, leaf_count, pair.y, b);
    float cost = cost_fits_leaf(members) ? area : area + cost_of_pair(a, b, 8, &firsts);
    to[0] = cost;
    for (uint roots = 2; roots <= COST_ROOTS; ++roots) {
        const float shared = cost_of_pair(a, b, roots, &firsts);
        cost = shared < cost ? shared : cost;
        to[roots - 1] = cost;
    }
}

#endif
