// The tree: eight children a node, eight primitives a leaf, as the builder (build_*.cl) writes it and both traversals read it.
//
// A node is 56 words: low x, y, z and high x, y, z of its children's boxes, eight each, then eight references. Children fill
// the front. A reference is BVH_EMPTY, the number of a node, or with BVH_LEAF the number of a pack of triangles, or with BVH_LEAF
// and BVH_ROUND that of a pack of spheres and disks. Packs hold up to eight primitives of one kind, coordinate by coordinate.
#ifndef GEOMETRY_BVH_H
#define GEOMETRY_BVH_H

#define BVH_NODE_WORDS 56
#define BVH_EMPTY 0xffffffffu
#define BVH_LEAF 0x80000000u
#define BVH_ROUND 0x40000000u
#define BVH_INDEX 0x3fffffffu
#define BVH_LOW 0
#define BVH_HIGH 24
#define BVH_CHILD 48

// Triangles as triangle.h prepares them, eight numbers each: a, ab, ca, normal, three axes each, size, unsure, diagonal; then the
// primitives' numbers, NONE where the pack is not full. With BVH_PAIR the primitive and the next one are a parallelogram.
#define TRIANGLE_PACK_WORDS 128
#define TRIANGLE_PACK_ID 120
#define BVH_PAIR 0x80000000u
// Centre x, y, z, radius, normal x, y, z (zero for a sphere); then the primitives' numbers.
#define ROUND_PACK_WORDS 64
#define ROUND_PACK_ID 56

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

#endif
