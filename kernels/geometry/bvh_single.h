// Rays that go through the tree each on its own: against the eight boxes of a node or the eight members of a pack at a time.
//
// They take turns, a node or a pack each: while one waits for memory the others go on. No step has a branch on what the ray meets,
// which no processor predicts.
#ifndef GEOMETRY_BVH_SINGLE_H
#define GEOMETRY_BVH_SINGLE_H

#include "geometry/bvh.h"
#include "geometry/wide.h"
#include "types.h"

// Subtrees that may be handed to a ray before it sets out.
#define SINGLE_STARTS 32
// Beyond what a ray needs below one of them, a step writes all eight children, and counts only those that the ray enters.
#define SINGLE_STACK (BVH_STACK + SINGLE_STARTS + 8)

// The lanes' rays, and what each has still to visit: a reference, and above it the bits of the distance where the ray enters.
typedef struct {
    float origin[3][LANES], direction[3][LANES], inverse[3][LANES], slack[LANES], inverse2[LANES];
    uint flip[3][LANES];         // from the low planes of a node's boxes to the high ones where the ray goes down the axis, else 0
    uint from[LANES], to[LANES];
    float nearest[LANES];        // distance of the nearest hit so far; negative once an occluder was found
    uint primitive[LANES];       // its number
    int top[LANES];              // of the stack; -1 where it is empty
    ulong stack[LANES][SINGLE_STACK];
} SingleRays;

static ulong single_entry(uint reference, float entered) { return (ulong)as_uint(entered) << 32 | reference; }

// Keep the nearest of the pack's hits; of equally near ones the lowest number, so that the order of visits does not matter.
// `entered` is where the ray enters the leaf's box, `later` where it hits the second of a pair, `members` how many of the eight count.
static void single_keep(SingleRays* rays, int lane, int8 hit, int8 later, float8 distance, float entered, __global const float* ids,
                        uint members, int any_hit) {
    const uint8 words = as_uint8(vload8(0, ids)), first = words & ~(BVH_PAIR | BVH_NUMBER), pair = words >> 31;
    const float8 at = distance < entered ? (float8)(entered) : distance;
    const float nearest = rays->nearest[lane];
    int8 keep = hit & ((int8)(0, 1, 2, 3, 4, 5, 6, 7) < (int)members) & (at > BOX_START) & (at <= nearest) & (rays->from[lane] - first > pair);
    if (any_hit) {
        keep &= rays->to[lane] - first > pair;
        rays->nearest[lane] = any_of_eight(keep) ? -1.0f : nearest;
        return;
    }
    const float least = least_of_eight(keep ? at : (float8)(NEVER));
    const uint8 ids_there = (keep & (at == least)) ? first + (later ? pair : (uint8)(0)) : (uint8)(NONE);
    const uint id = least_uint_of_eight(ids_there);
    const int nearer = least < nearest || (least == nearest && id < rays->primitive[lane]);
    rays->nearest[lane] = nearer ? least : nearest;
    rays->primitive[lane] = nearer ? id : rays->primitive[lane];
}

static void single_triangles(SingleRays* rays, int lane, const Bvh* bvh, uint reference, float entered, int any_hit) {
    __global const float* pack = bvh_pack(bvh->triangle_packs, TRIANGLE_BLOCK_WORDS, reference);
    const float8 from_x = rays->origin[0][lane] - vload8(0, pack), from_y = rays->origin[1][lane] - vload8(1, pack);
    const float8 from_z = rays->origin[2][lane] - vload8(2, pack);
    const float8 nx = vload8(9, pack), ny = vload8(10, pack), nz = vload8(11, pack);
    float8 determinant, b, c;
    const int8 hit = triangle_hit_pack(from_x, from_y, from_z, vload8(3, pack), vload8(4, pack), vload8(5, pack), vload8(6, pack),
                                       vload8(7, pack), vload8(8, pack), nx, ny, nz, vload8(12, pack), vload8(13, pack),
                                       vload8(14, pack), (float8)(rays->direction[0][lane]), (float8)(rays->direction[1][lane]),
                                       (float8)(rays->direction[2][lane]), (float8)(rays->slack[lane]), &determinant, &b, &c);
    const float8 distance = triangle_distance_pack(from_x, from_y, from_z, nx, ny, nz, determinant);
    single_keep(rays, lane, hit, c > b, distance, entered, pack + TRIANGLE_ID, bvh_members(reference), any_hit);
}

static void single_analytic(SingleRays* rays, int lane, const Bvh* bvh, uint reference, float entered, int any_hit) {
    __global const float* pack = bvh_pack(bvh->analytic_packs, ANALYTIC_BLOCK_WORDS, reference);
    const float8 from_x = rays->origin[0][lane] - vload8(0, pack), from_y = rays->origin[1][lane] - vload8(1, pack);
    const float8 from_z = rays->origin[2][lane] - vload8(2, pack);
    const float8 radius = vload8(3, pack), nx = vload8(4, pack), ny = vload8(5, pack), nz = vload8(6, pack);
    const float8 dx = (float8)(rays->direction[0][lane]), dy = (float8)(rays->direction[1][lane]);
    const float8 dz = (float8)(rays->direction[2][lane]);
    float8 sphere_distance, disk_distance, distance, place_u, place_v;
    const int8 sphere = sphere_hit_pack(-from_x, -from_y, -from_z, radius, dx, dy, dz, (float8)(rays->inverse2[lane]), &sphere_distance);
    const int8 flat = disk_hit_pack(-from_x, -from_y, -from_z, radius, nx, ny, nz, dx, dy, dz, &disk_distance);
    const uint8 kind = as_uint8(vload8(ANALYTIC_KIND / 8, pack)) & ~BVH_NUMBER;
    const int8 disk = kind == ANALYTIC_DISK, rectangle = kind >= ANALYTIC_RECTANGLE;
    const int8 x = kind == ANALYTIC_RECTANGLE, y = kind == ANALYTIC_RECTANGLE + 1u;
    const float8 inverse = x ? (float8)(rays->inverse[0][lane]) : (y ? (float8)(rays->inverse[1][lane]) : (float8)(rays->inverse[2][lane]));
    const int8 upright = rectangle_hit_pack(x ? from_x : (y ? from_y : from_z), -inverse, x ? from_y : (y ? from_z : from_x),
                                            x ? from_z : (y ? from_x : from_y), x ? dy : (y ? dz : dx), x ? dz : (y ? dx : dy), radius,
                                            nx, &distance, &place_u, &place_v);
    const int8 second = rectangle & rectangle_second_pack(place_u, place_v, ny, nz);
    distance = rectangle ? distance : (disk ? disk_distance : sphere_distance);
    single_keep(rays, lane, rectangle ? upright : (disk ? flat : sphere), second, distance, entered, pack + ANALYTIC_ID,
                bvh_members(reference), any_hit);
}

// Push the children that the ray enters, the nearest last. The boxes' near planes are known by the ray's direction, which gives the
// same interval as sorting them does (geometry/box.inc): rounding is monotonic.
static void single_children(SingleRays* rays, int lane, __global const float* node) {
    float8 near_at[3], far_at[3];
    #pragma unroll
    for (int k = 0; k < 3; ++k) {
        const uint flip = rays->flip[k][lane];
        near_at[k] = (vload8(k, node + BVH_LOW + flip) - rays->origin[k][lane]) * rays->inverse[k][lane];
        far_at[k] = (vload8(k, node + BVH_HIGH - flip) - rays->origin[k][lane]) * rays->inverse[k][lane];
    }
    float8 near, far;
    box_clip_pack(near_at[0], near_at[1], near_at[2], far_at[0], far_at[1], far_at[2], &near, &far);
    const int8 passes = (near <= far) & (near <= rays->nearest[lane]);

    // Each child's place among those to push: how many are pushed before it. Distances count but for their last three bits, which
    // are the child's number, so that no two are equal; what is not entered comes last of all and is left above the top.
    const int8 number = (int8)(0, 1, 2, 3, 4, 5, 6, 7);
    const int8 key = passes ? (as_int8(near) & ~7) | number : number;
    int8 place = (int8)(0);
    place -= key.s12345670 > key, place -= key.s23456701 > key, place -= key.s34567012 > key, place -= key.s45670123 > key;
    place -= key.s56701234 > key, place -= key.s67012345 > key, place -= key.s70123456 > key;
    int places[8];
    ulong entries[8];
    const uint8 references = as_uint8(vload8(0, node + BVH_CHILD));
    vstore8(place, 0, places);
    vstore8(convert_ulong8(as_uint8(near)) << 32 | convert_ulong8(references), 0, entries);
    ulong* above = rays->stack[lane] + rays->top[lane] + 1;
    #pragma unroll
    for (int i = 0; i < 8; ++i) above[places[i]] = entries[i];
    rays->top[lane] += count_of_eight(passes);
}

// The memory that the lane's next step reads, asked for a round before it is needed. In small trees it is near anyway.
static void single_prefetch(const Bvh* bvh, const SingleRays* rays, int lane) {
#ifdef BVH_PREFETCH
    const uint next = (uint)rays->stack[lane][max(rays->top[lane], 0)];
    __global const float* pack = bvh_pack(bvh->triangle_packs, TRIANGLE_BLOCK_WORDS, next & BVH_ANALYTIC ? 0 : next);
    __global const float* node = bvh->nodes + (size_t)(next & BVH_INDEX) * BVH_NODE_WORDS;
    const size_t leaf = 0 - (size_t)(next >> 31);
    __global const float* at = (__global const float*)(((size_t)pack & leaf) | ((size_t)node & ~leaf));
    #pragma unroll
    for (int line = 0; line < TRIANGLE_BLOCK_WORDS / 16; ++line) __builtin_prefetch(at + line * 16);
#endif
}

// Every ray through all that is on its stack. With any_hit a ray ends at its first occluder.
static void bvh_single(const Bvh* bvh, SingleRays* rays, int any_hit) {
    int queue[LANES];
    int count = 0;
    for (int lane = 0; lane < LANES; ++lane) {
        queue[count] = lane;
        count += rays->top[lane] >= 0 ? 1 : 0;
    }
    while (count > 0) {
        int left = 0;
        for (int i = 0; i < count; ++i) {
            const int lane = queue[i];
            const ulong entry = rays->stack[lane][rays->top[lane]--];
            const float entered = as_float((uint)(entry >> 32));
            const uint reference = (uint)entry;
            if (entered <= rays->nearest[lane]) {
                if (!(reference & BVH_LEAF))
                    single_children(rays, lane, bvh->nodes + (size_t)reference * BVH_NODE_WORDS);
                else if (reference & BVH_ANALYTIC)
                    single_analytic(rays, lane, bvh, reference, entered, any_hit);
                else
                    single_triangles(rays, lane, bvh, reference, entered, any_hit);
            }
            single_prefetch(bvh, rays, lane);
            queue[left] = lane;
            left += rays->top[lane] >= 0 ? 1 : 0;
        }
        count = left;
    }
}

#endif
