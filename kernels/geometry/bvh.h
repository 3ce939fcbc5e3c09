// The tree: eight children a node, eight primitives a leaf, as the builder (build_*.cl) writes it and both traversals read it.
//
// A node is 56 words: low x, y, z and high x, y, z of its children's boxes, eight each, then eight references. Children fill
// the front. A reference is BVH_EMPTY, the number of a node, or with BVH_LEAF a pack: of triangles, or with BVH_ANALYTIC of spheres,
// disks and rectangles. It tells how many members the pack has, less one, above BVH_COUNT, and where they begin. With BVH_INSTANCE, and
// without BVH_LEAF, it is the number of an instance (geometry/instance.h).
//
// Packs lie in blocks of eight columns, a member a column. Siblings share a block where they fit, which spares a quarter of the memory:
// so who reads eight columns from a pack's first reads what is not the pack's, and has to leave it out.
#ifndef GEOMETRY_BVH_H
#define GEOMETRY_BVH_H

#define BVH_NODE_WORDS 56
#define BVH_EMPTY 0xffffffffu
#define BVH_LEAF 0x80000000u
#define BVH_ANALYTIC 0x40000000u
#define BVH_INSTANCE 0x40000000u
#define BVH_COUNT 27
#define BVH_INDEX 0x07ffffffu
#define BVH_LOW 0
#define BVH_HIGH 24
#define BVH_CHILD 48

// Rows of a block of triangles, as triangle.h prepares them: a, ab, ca, normal, three axes each, size_ab, unsure, size_ca; then
// the primitives' numbers. With BVH_PAIR the primitive and the next one are a parallelogram.
#define TRIANGLE_BLOCK_WORDS 128
#define TRIANGLE_ID 120
#define BVH_PAIR 0x80000000u
// Rows of a block of what is no triangle: centre x, y, z; radius, and a disk's normal x, y, z; which of the kinds below; then the
// primitives' numbers. Two triangles that are a rectangle square to an axis have in the place of radius and normal half their extents
// along the next axis and the one after it, and the two numbers by which the second triangle is told from the first (rectangle.inc).
#define ANALYTIC_BLOCK_WORDS 72
#define ANALYTIC_KIND 56
#define ANALYTIC_ID 64
#define ANALYTIC_SPHERE 0u
#define ANALYTIC_DISK 1u
#define ANALYTIC_RECTANGLE 2u    // square to x; then to y, to z
// A curve has where it begins, its number instead of a radius, and its chord; beside its kind the bits, but for the last five, of how far it
// comes from its chord.
#define ANALYTIC_CURVE 8u
#define ANALYTIC_CURVE_BEFORE 1u  // and these, if another curve goes on from its beginning, from its end
#define ANALYTIC_CURVE_AFTER 2u
#define ANALYTIC_CURVE_REACH 4
#define ANALYTIC_KINDS 15u
// In a list of units, beside BVH_PAIR: the pair is a rectangle square to an axis.
#define BVH_RECTANGLE 0x20000000u
// Set in all numbers of primitives and kinds: as a float it is a normal number, which processors multiply as fast as any.
#define BVH_NUMBER 0x40000000u

// Entries a traversal may have to keep: seven for each level of the tree. The host sets it for trees deeper than usual.
#ifndef BVH_STACK
#define BVH_STACK 96
#endif

// Words of an instance's two rows.
#define INSTANCE_WORDS 32
// And of its motion: its first knot, and how many more there are; of a mesh that changes its form the first row, and at how many times it has any.
#define INSTANCE_MOTION_WORDS 4

// Whether a ray that is aimed at a primitive passes it in any search, or only in one for any hit, which is all that shadow rays need where
// surfaces have no holes.
#ifdef OPACITY
#define BVH_PASSES_TARGET(any_hit) 1
#else
#define BVH_PASSES_TARGET(any_hit) (any_hit)
#endif

typedef struct {
    __global const float* nodes;
    __global const float* triangle_packs;
    __global const float* analytic_packs;
    uint root;           // a reference
#ifdef INSTANCES
    __global const float* instance_rows;
    uint instance_root;                      // column of an instance's row with the reference of its own tree
#ifdef MOTION
    __global const float* motion_rows;       // geometry/motion.h
    __global const uint* instance_motions;   // INSTANCE_MOTION_WORDS words an instance
#endif
#endif
#ifdef CURVES
    __global const float* curve_rows;
#endif
#ifdef HOLES
    __global const uint* hole_rows;          // of masked triangles (geometry/holes.h); of a tree over others 0
    __global const float* attribute_rows;
#endif
} Bvh;

#ifdef CURVES
// The derivative of a curve at its beginning or end: of x, y, z and the radius. Where the place does not change, the radius counts as if it
// did not, either.
static void bvh_curve_slope(__global const float* row, int at_end, float slope[4]) {
    float sizes = 0.0f, moves = 0.0f;
    for (int i = 0; i < 4; ++i) {
        slope[i] = at_end ? fma(row[12 + i], 3.0f, fma(row[8 + i], 2.0f, row[4 + i])) : row[4 + i];
        if (i < 3) moves += fabs(slope[i]), sizes += fabs(row[4 + i]) + fabs(row[8 + i]) + fabs(row[12 + i]);
    }
    if (moves <= 1.0e-5f * sizes) slope[3] = 0.0f;
}
#endif

// How many members the pack has that a reference leads to.
static uint bvh_members(uint reference) { return (reference >> BVH_COUNT & 7u) + 1u; }

// The first column of a pack.
static __global const float* bvh_pack(__global const float* blocks, size_t block_words, uint reference) {
    return blocks + (reference & BVH_INDEX) / 8u * block_words + reference % 8u;
}

#endif
