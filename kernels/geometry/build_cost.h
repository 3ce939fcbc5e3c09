// What a ray has to do below a node of the binary tree, once it is collapsed into wide nodes: the chance that it comes there, which is
// the area of the box, times one step for a node or a pack alike (surface area heuristic; Ylitie, Karras & Laine 2017 for the
// cheapest way to collapse, which is found from the bottom up).
//
// `costs` holds COST_ROOTS numbers a node: the least cost of what is below it, as a forest of at most 1, 2, … 7 trees.
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

static float cost_of(__global const float* costs, uint node, uint roots) {
    return costs[(size_t)node * COST_ROOTS + roots - 1];
}

// The least cost of a pair of subtrees as so many trees together, and how many of them are the first one's.
static float cost_of_pair(__global const float* costs, uint2 pair, uint roots, uint* firsts) {
    float least = NEVER;
    *firsts = 1;
    for (uint first = 1; first < roots; ++first) {
        const float cost = cost_of(costs, pair.x, first) + cost_of(costs, pair.y, roots - first);
        if (cost < least) least = cost, *firsts = first;
    }
    return least;
}

// A single unit: a leaf, whatever is asked.
static void cost_save_unit(__global float* costs, uint node, Box box) {
    const float cost = cost_area(box);
    for (uint i = 0; i < COST_ROOTS; ++i) costs[(size_t)node * COST_ROOTS + i] = cost;
}

static void cost_save_pair(__global float* costs, uint node, Box box, uint members, uint2 pair) {
    const float area = cost_area(box);
    uint firsts;
    float cost = cost_fits_leaf(members) ? area : area + cost_of_pair(costs, pair, 8, &firsts);
    costs[(size_t)node * COST_ROOTS] = cost;
    for (uint roots = 2; roots <= COST_ROOTS; ++roots) {
        const float shared = cost_of_pair(costs, pair, roots, &firsts);
        cost = shared < cost ? shared : cost;
        costs[(size_t)node * COST_ROOTS + roots - 1] = cost;
    }
}

#endif
