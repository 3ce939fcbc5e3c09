// The tree: eight children a node, eight primitives a leaf, as the builder (build_*.cl) writes it and both traversals read it.
//
// A node is 56 words: low x, y, z and high x, y, z of its children's boxes, eight each, then eight references. Children fill
// the front. A reference is BVH_EMPTY, the number of a node, or with BVH_LEAF a pack: of triangles, or with BVH_ROUND of spheres and
// disks. It tells how many members the pack has, less one, above BVH_COUNT, and where they begin.
//
// Packs lie in blocks of eight columns, a member a column. Siblings share a block where they fit, which spares a quarter of the memory:
// so who reads eight columns from a pack's first reads what is not the pack's, and has to leave it out.
#ifndef GEOMETRY_BVH_H
#define GEOMETRY_BVH_H

#define BVH_NODE_WORDS 56
#define BVH_EMPTY 0xffffffffu
#define BVH_LEAF 0x80000000u
#define BVH_ROUND 0x40000000u
#define BVH_COUNT 27
#define BVH_INDEX 0x07ffffffu
#define BVH_LOW 0
#define BVH_HIGH 24
#define BVH_CHILD 48

// Rows of a block of triangles, as triangle.h prepares them: a, ab, ca, normal, three axes each, size, unsure, diagonal; then the
// primitives' numbers. With BVH_PAIR the primitive and the next one are a parallelogram.
#define TRIANGLE_BLOCK_WORDS 128
#define TRIANGLE_ID 120
#define BVH_PAIR 0x80000000u
// Centre x, y, z, radius, normal x, y, z (zero for a sphere); then the primitives' numbers.
#define ROUND_BLOCK_WORDS 64
#define ROUND_ID 56
// Set in all numbers of primitives: as a float it is a normal number, which processors multiply as fast as any.
#define BVH_NUMBER 0x40000000u

// Entries a traversal may have to keep: seven for each level of the tree. The host sets it for trees deeper than usual.
#ifndef BVH_STACK
#define BVH_STACK 96
#endif

typedef struct {
    __global const float* nodes;
    __global const float* triangle_packs;
    __global const float* round_packs;
    uint root;           // a reference
} Bvh;

// How many members the pack has that a reference leads to.
static uint bvh_members(uint reference) { return (reference >> BVH_COUNT & 7u) + 1u; }

// The first column of a pack.
static __global const float* bvh_pack(__global const float* blocks, size_t block_words, uint reference) {
    return blocks + (reference & BVH_INDEX) / 8u * block_words + reference % 8u;
}

#endif
