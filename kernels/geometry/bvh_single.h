// Rays that go through the tree each on its own: against the eight boxes of a node or the eight members of a pack at a time.
//
// They take turns, a node or a pack each: while one waits for memory the others go on. No step has a branch on what the ray meets,
// which no processor predicts.
#ifndef GEOMETRY_BVH_SINGLE_H
#define GEOMETRY_BVH_SINGLE_H

#include "geometry/bvh.h"
#include "geometry/holes.h"
#include "geometry/motion.h"
#include "geometry/pose.h"
#include "geometry/wide.h"
#include "types.h"

// Subtrees that may be handed to a ray before it sets out, and rays on their way together.
#define SINGLE_STARTS 64
#define SINGLE_RAYS (LANES * PACKETS)
// Of an instance's reference on a ray's stack: the entry below it is in the instance, in the place of its tree's root.
#define SINGLE_WITHIN 0x20000000u
// Beyond what a ray needs below one of them, a step writes all eight children, and counts only those that the ray enters.
#define SINGLE_STACK (BVH_STACK + SINGLE_STARTS + 8)

// The rays of all packets' lanes, and what each has still to visit: a reference, and above it the bits of the distance where the ray enters.
typedef struct {
    float origin[3][SINGLE_RAYS], direction[3][SINGLE_RAYS], slack[SINGLE_RAYS], inverse2[SINGLE_RAYS];
    float minus_inverse[3][SINGLE_RAYS];                             // −1 over the direction
    uint near_plane[3][SINGLE_RAYS], far_plane[3][SINGLE_RAYS];      // where nodes have those planes of boxes that the ray meets first, last
    uint from[SINGLE_RAYS], to[SINGLE_RAYS];
#ifdef OPACITY
    float after[SINGLE_RAYS];
    uint after_primitive[SINGLE_RAYS];
#endif
    float nearest[SINGLE_RAYS];  // distance of the nearest hit so far; negative once an occluder was found
    uint primitive[SINGLE_RAYS]; // its number
    int top[SINGLE_RAYS];        // of the stack; -1 where it is empty
#ifdef INSTANCES
    float world[6][SINGLE_RAYS]; // origin and direction outside of instances
    float start[SINGLE_RAYS];    // where it enters the instance that it is in; elsewhere BOX_START
    int base[SINGLE_RAYS];       // of the stack's entries those below it are in the world
    uint triangle_offset[SINGLE_RAYS], analytic_offset[SINGLE_RAYS];     // from primitives in packs to their numbers
#endif
#ifdef MOTION
    float time[SINGLE_RAYS];
#endif
#ifdef DEFORMATION
    uint instance[SINGLE_RAYS];  // that it is in; NONE: none
#endif
    ulong stack[SINGLE_RAYS][SINGLE_STACK];
} SingleRays;

// Whether hits of these primitives are behind what is left out, and how far from the ray's origin that reaches.
#ifdef OPACITY
static int8 single_counts(const SingleRays* rays, int ray, float8 at, uint8 id) {
    return (at > rays->after[ray]) | ((at == rays->after[ray]) & (id > rays->after_primitive[ray]));
}
static float8 single_after(const SingleRays* rays, int ray) { return (float8)(rays->after[ray]); }
static int8 single_reaches(const SingleRays* rays, int ray, float8 far) { return far >= rays->after[ray]; }
#else
static int8 single_counts(const SingleRays* rays, int ray, float8 at, uint8 id) { return at > BOX_START; }
static float8 single_after(const SingleRays* rays, int ray) { return (float8)(0.0f); }
static int8 single_reaches(const SingleRays* rays, int ray, float8 far) { return (int8)(-1); }
#endif

#ifdef INSTANCES
static float8 single_begin(const SingleRays* rays, int ray) { return (float8)(rays->start[ray]); }
static uint8 single_triangle_offset(const SingleRays* rays, int ray) { return (uint8)(rays->triangle_offset[ray]); }
static uint8 single_analytic_offset(const SingleRays* rays, int ray, int8 rectangle) {
    return rectangle ? (uint8)(rays->triangle_offset[ray]) : (uint8)(rays->analytic_offset[ray]);
}
#else
static float8 single_begin(const SingleRays* rays, int ray) { return (float8)(BOX_START); }
static uint8 single_triangle_offset(const SingleRays* rays, int ray) { return (uint8)(0); }
static uint8 single_analytic_offset(const SingleRays* rays, int ray, int8 rectangle) { return (uint8)(0); }
#endif

static ulong single_entry(uint reference, float entered) { return (ulong)as_uint(entered) << 32 | reference; }

// Keep the nearest of the pack's hits; of equally near ones the lowest number, so that the order of visits does not matter.
// `entered` is where the ray enters the leaf's box, `later` where it hits the second of a pair, `members` how many of the eight count.
static void single_keep(SingleRays* rays, int ray, int8 hit, int8 later, float8 distance, float entered, __global const float* ids,
                        uint8 offset, uint members, int any_hit) {
    const uint8 words = as_uint8(vload8(0, ids)), first = (words & ~(BVH_PAIR | BVH_NUMBER)) + offset, pair = words >> 31;
    const float8 at = distance < entered ? (float8)(entered) : distance;
    const float nearest = rays->nearest[ray];
    const uint8 id_there = first + (later ? pair : (uint8)(0));
    int8 keep = hit & ((int8)(0, 1, 2, 3, 4, 5, 6, 7) < (int)members) & single_counts(rays, ray, at, id_there) & (at <= nearest) &
                (rays->from[ray] - first > pair);
    if (BVH_PASSES_TARGET(any_hit)) keep &= rays->to[ray] - first > pair;
    if (any_hit) {
        rays->nearest[ray] = any_of_eight(keep) ? -1.0f : nearest;
        return;
    }
    const float least = least_of_eight(keep ? at : (float8)(NEVER));
    const uint id = least_uint_of_eight((keep & (at == least)) ? id_there : (uint8)(NONE));
    const int nearer = least < nearest || (least == nearest && id < rays->primitive[ray]);
    rays->nearest[ray] = nearer ? least : nearest;
    rays->primitive[ray] = nearer ? id : rays->primitive[ray];
}

// The hits of a pack's triangles that count: those that are not in holes. Of any hits, only those where the surface is known to be whole;
// others are remembered by a primitive number.
static int8 single_solid(const Bvh* bvh, SingleRays* rays, int ray, __global const float* ids, uint members, int8 hit, float8 distance,
                         float8 determinant, float8 b, float8 c, int any_hit) {
#ifdef HOLES
    if (bvh->hole_rows == 0) return hit;
    const int8 own = hit & (distance <= rays->nearest[ray]) & ((int8)(0, 1, 2, 3, 4, 5, 6, 7) < (int)members);
    if (!any_of_eight(own)) return own;
    int hits[8];
    float determinants[8], weights_b[8], weights_c[8];
    vstore8(own, 0, hits);
    vstore8(determinant, 0, determinants);
    vstore8(b, 0, weights_b);
    vstore8(c, 0, weights_c);
    for (uint k = 0; k < members; ++k) {
        if (!hits[k]) continue;
        const int known = holes_at(bvh, as_uint(ids[k]), determinants[k], weights_b[k], weights_c[k]);
        if (known == HOLES_HOLE || (any_hit && known == HOLES_UNKNOWN)) hits[k] = 0;
        if (any_hit && known == HOLES_UNKNOWN) rays->primitive[ray] = 0u;
    }
    return vload8(0, hits);
#else
    return hit;
#endif
}

#ifdef DEFORMATION
// The triangles of a mesh that changes its form, at the ray's time.
static void single_deforming(SingleRays* rays, int ray, const Bvh* bvh, Poses poses, uint reference, float entered, int any_hit) {
    __global const float* ids = bvh_pack(bvh->triangle_packs, TRIANGLE_BLOCK_WORDS, reference) + TRIANGLE_ID;
    const uint begin = as_uint(bvh->instance_rows[(size_t)rays->instance[ray] * INSTANCE_WORDS + 16 + PLACEMENT_ROW_FIRST]);
    const uint members = bvh_members(reference);
    const float time = rays->time[ray];
    uint low = 0u, high = poses.knots > 1u ? poses.knots - 2u : 0u;
    while (low < high) {
        const uint middle = (low + high + 1u) >> 1;
        if (bvh->motion_rows[((size_t)poses.first + (size_t)middle * poses.stride) * 16 + MOTION_ROW_TIME] <= time) low = middle;
        else high = middle - 1u;
    }
    __global const float* knot = bvh->motion_rows + ((size_t)poses.first + (size_t)low * poses.stride) * 16;
    const size_t step = poses.knots > 1u ? (size_t)poses.stride * 16 : 0;
    float row[16], a[9][8], b[9][8];
    for (int k = 0; k < 16; ++k) row[k] = knot[k];
    const float8 share = (float8)(motion_share_one(row, time));
    for (uint m = 0; m < 8u; ++m) {
        const uint member = m < members ? m : 0u;        // others do not count
        const uint number = (as_uint(ids[member]) & ~BVH_NUMBER) + rays->triangle_offset[ray] - begin;
        __global const float* at = knot + (size_t)number * 16;
        for (int k = 0; k < 9; ++k) a[k][m] = at[k], b[k][m] = at[k + step];
    }
    float8 corners[9], t[15], determinant, weight_b, weight_c;
    for (int k = 0; k < 9; ++k) corners[k] = pose_between_pack(vload8(0, a[k]), vload8(0, b[k]), share);
    pose_triangle_pack(corners, t);
    const float8 from_x = rays->origin[0][ray] - t[0], from_y = rays->origin[1][ray] - t[1], from_z = rays->origin[2][ray] - t[2];
    const int8 hit = triangle_hit_pack(from_x, from_y, from_z, t[3], t[4], t[5], t[6], t[7], t[8], t[9], t[10], t[11], t[12], t[13], t[14],
                                       (float8)(rays->direction[0][ray]), (float8)(rays->direction[1][ray]), (float8)(rays->direction[2][ray]),
                                       (float8)(rays->slack[ray]), &determinant, &weight_b, &weight_c);
    const float8 distance = triangle_distance_pack(from_x, from_y, from_z, t[9], t[10], t[11], determinant);
#ifdef HOLES
    // Nothing is known of their holes
    if (any_hit && bvh->hole_rows != 0) {
        const int8 counts = (int8)(0, 1, 2, 3, 4, 5, 6, 7) < (int)members;
        if (any_of_eight(hit & counts & (distance <= rays->nearest[ray]))) rays->primitive[ray] = 0u;
        return;
    }
#endif
    single_keep(rays, ray, hit, (int8)(0), distance, entered, ids, single_triangle_offset(rays, ray), members, any_hit);
}
#endif

static void single_triangles(SingleRays* rays, int ray, const Bvh* bvh, uint reference, float entered, int any_hit) {
#ifdef DEFORMATION
    if (rays->instance[ray] != NONE) {
        const Poses poses = poses_of(bvh, rays->instance[ray]);
        if (poses.knots > 0u) {
            single_deforming(rays, ray, bvh, poses, reference, entered, any_hit);
            return;
        }
    }
#endif
    __global const float* pack = bvh_pack(bvh->triangle_packs, TRIANGLE_BLOCK_WORDS, reference);
    const float8 from_x = rays->origin[0][ray] - vload8(0, pack), from_y = rays->origin[1][ray] - vload8(1, pack);
    const float8 from_z = rays->origin[2][ray] - vload8(2, pack);
    const float8 nx = vload8(9, pack), ny = vload8(10, pack), nz = vload8(11, pack);
    float8 determinant, b, c;
    const int8 hit = triangle_hit_pack(from_x, from_y, from_z, vload8(3, pack), vload8(4, pack), vload8(5, pack), vload8(6, pack),
                                       vload8(7, pack), vload8(8, pack), nx, ny, nz, vload8(12, pack), vload8(13, pack),
                                       vload8(14, pack), (float8)(rays->direction[0][ray]), (float8)(rays->direction[1][ray]),
                                       (float8)(rays->direction[2][ray]), (float8)(rays->slack[ray]), &determinant, &b, &c);
    const float8 distance = triangle_distance_pack(from_x, from_y, from_z, nx, ny, nz, determinant);
    const int8 there = single_solid(bvh, rays, ray, pack + TRIANGLE_ID, bvh_members(reference), hit, distance, determinant, b, c, any_hit);
    single_keep(rays, ray, there, c > b, distance, entered, pack + TRIANGLE_ID, single_triangle_offset(rays, ray), bvh_members(reference),
                any_hit);
}

#ifdef CURVES
// Those of a pack's members that are curves; see packet_curve. `from`: from where each begins to the ray's origin.
static int8 single_curves(const SingleRays* rays, int ray, const Bvh* bvh, uint8 kind, __global const float* pack, const float8 from[3],
                          uint members, int any_hit, float8* distance) {
    const float8 reach = as_float8(kind >> ANALYTIC_CURVE_REACH << 5), dx = (float8)(rays->direction[0][ray]);
    const float8 dy = (float8)(rays->direction[1][ray]), dz = (float8)(rays->direction[2][ray]), inverse2 = (float8)(rays->inverse2[ray]);
    const int8 curve = ((kind & ANALYTIC_CURVE) != 0u) & ((int8)(0, 1, 2, 3, 4, 5, 6, 7) < (int)members) &
                       curve_near_pack(-from[0], -from[1], -from[2], vload8(4, pack), vload8(5, pack), vload8(6, pack), reach, dx, dy, dz, inverse2);
    if (!any_of_eight(curve)) return curve;
    uint number[8];
    int wanted[8];
    float k[CURVE_WORDS][8], t[4][8];
    vstore8(as_uint8(vload8(3, pack)) & ~BVH_NUMBER, 0, number);
    vstore8(curve, 0, wanted);
    float8 row[CURVE_WORDS];
    uint some = 0;
    for (uint m = 0; m < 8; ++m) some = wanted[m] ? number[m] : some;
    for (uint m = 0; m < 8; ++m) {
        __global const float* own = bvh->curve_rows + (size_t)(wanted[m] ? number[m] : some) * CURVE_WORDS;
        for (int i = 0; i < CURVE_WORDS; ++i) k[i][m] = own[i];
    }
    for (int i = 0; i < CURVE_WORDS; ++i) row[i] = vload8(0, k[i]);
    CurveHit_pack found;
    int8 hit = curve & curve_hit_pack(row, (float8)(rays->origin[0][ray]), (float8)(rays->origin[1][ray]), (float8)(rays->origin[2][ray]), dx, dy, dz,
                                      inverse2, single_after(rays, ray), &found);
    *distance = found.distance;
    if (BVH_PASSES_TARGET(any_hit)) {
        const uint8 before = kind & ANALYTIC_CURVE_BEFORE, more = before + (kind >> 1 & 1u);
        const uint8 primitive = (as_uint8(vload8(ANALYTIC_ID / 8, pack)) & ~BVH_NUMBER) + single_analytic_offset(rays, ray, (int8)(0));
        hit &= rays->to[ray] - (primitive - before) > more;
    }
    const int8 begins = hit & (found.u <= 0.0f) & ((kind & ANALYTIC_CURVE_BEFORE) != 0u);
    const int8 ends = hit & (found.u >= 1.0f) & ((kind & ANALYTIC_CURVE_AFTER) != 0u);
    if (!any_of_eight(begins | ends)) return hit;
    int before[8], after[8];
    vstore8(begins, 0, before);
    vstore8(ends, 0, after);
    for (uint m = 0; m < 8; ++m) {
        __global const float* own = bvh->curve_rows + (size_t)(wanted[m] ? number[m] : some) * CURVE_WORDS;
        float slope[4] = {0.0f, 0.0f, 0.0f, 0.0f};
        if (before[m] | after[m]) bvh_curve_slope(before[m] ? own - CURVE_WORDS : own + CURVE_WORDS, before[m] != 0, slope);
        for (int i = 0; i < 4; ++i) t[i][m] = slope[i];
    }
    const float8 x = vload8(0, t[0]), y = vload8(0, t[1]), z = vload8(0, t[2]), widens = vload8(0, t[3]);
    return hit & (!begins | curve_shows_pack(&found, x, y, z, widens, 1.0f)) & (!ends | curve_shows_pack(&found, x, y, z, widens, -1.0f));
}
#endif

static void single_analytic(SingleRays* rays, int ray, const Bvh* bvh, uint reference, float entered, int any_hit) {
    __global const float* pack = bvh_pack(bvh->analytic_packs, ANALYTIC_BLOCK_WORDS, reference);
    const float8 from_x = rays->origin[0][ray] - vload8(0, pack), from_y = rays->origin[1][ray] - vload8(1, pack);
    const float8 from_z = rays->origin[2][ray] - vload8(2, pack);
    const float8 radius = vload8(3, pack), nx = vload8(4, pack), ny = vload8(5, pack), nz = vload8(6, pack);
    const float8 dx = (float8)(rays->direction[0][ray]), dy = (float8)(rays->direction[1][ray]);
    const float8 dz = (float8)(rays->direction[2][ray]);
    float8 sphere_distance, disk_distance, distance, place_u, place_v;
    const int8 sphere = sphere_hit_pack(-from_x, -from_y, -from_z, radius, dx, dy, dz, (float8)(rays->inverse2[ray]),
                                        single_after(rays, ray), &sphere_distance);
    const int8 flat = disk_hit_pack(-from_x, -from_y, -from_z, radius, nx, ny, nz, dx, dy, dz, &disk_distance);
    const uint8 kind = as_uint8(vload8(ANALYTIC_KIND / 8, pack)) & ~BVH_NUMBER;
    const int8 disk = kind == ANALYTIC_DISK, rectangle = kind - ANALYTIC_RECTANGLE < 3u;
    const int8 x = kind == ANALYTIC_RECTANGLE, y = kind == ANALYTIC_RECTANGLE + 1u;
    const float8 minus_x = (float8)(rays->minus_inverse[0][ray]), minus_y = (float8)(rays->minus_inverse[1][ray]);
    const float8 minus_inverse = x ? minus_x : (y ? minus_y : (float8)(rays->minus_inverse[2][ray]));
    const int8 upright = rectangle_hit_pack(x ? from_x : (y ? from_y : from_z), minus_inverse, x ? from_y : (y ? from_z : from_x),
                                            x ? from_z : (y ? from_x : from_y), x ? dy : (y ? dz : dx), x ? dz : (y ? dx : dy), radius,
                                            nx, &distance, &place_u, &place_v);
    const int8 second = rectangle & rectangle_second_pack(place_u, place_v, ny, nz);
    distance = rectangle ? distance : (disk ? disk_distance : sphere_distance);
    int8 met = rectangle ? upright : (disk ? flat : sphere);
#ifdef CURVES
    float8 curve_distance = distance;
    const int8 is_curve = (kind & ANALYTIC_CURVE) != 0u;
    const float8 from[3] = {from_x, from_y, from_z};
    const int8 tube = single_curves(rays, ray, bvh, kind, pack, from, bvh_members(reference), any_hit, &curve_distance);
    met = is_curve ? tube : met;
    distance = is_curve ? curve_distance : distance;
#endif
#ifdef HOLES
    // Nothing is known of their holes
    if (any_hit && bvh->hole_rows != 0) {
        const int8 counts = (int8)(0, 1, 2, 3, 4, 5, 6, 7) < (int)bvh_members(reference);
        if (any_of_eight(met & counts & (distance <= rays->nearest[ray]))) rays->primitive[ray] = 0u;
        return;
    }
#endif
    single_keep(rays, ray, met, second, distance, entered, pack + ANALYTIC_ID, single_analytic_offset(rays, ray, rectangle),
                bvh_members(reference), any_hit);
}

// The children to push, the one to visit first last, then any others. What is not entered comes behind them.
//
// Where any hit will do they stay as they lie: rays that meet nothing visit all of them. In small trees the nearest is the last, and the others stay: a
// ray meets one or two children, and comes back to few of those that are left. In large ones they are sorted, the farthest first: distances
// count but for their last three bits, which are the child's number, so that no two are equal.
static uint8 single_order(int8 passes, float8 near, int any_hit) {
    const uint8 number = (uint8)(0, 1, 2, 3, 4, 5, 6, 7), key = (as_uint8(near) & ~7u) | number;
#if LANES > 1 && defined(BVH_PREFETCH)
    return any_hit ? eight_to_front(passes) : eight_sorted(passes ? key : number) & 7u;
#elif LANES > 1
    uint8 order;
    if (any_hit)
        order = eight_to_front(passes);
    else {
        const uint nearest = least_uint_of_eight(passes ? key : (uint8)(NONE)) & 7u;
        order = eight_to_front(passes & (number != nearest));
        order = number == (uint)(count_of_eight(passes) - 1) ? (uint8)(nearest) : order;
    }
    return order;
#else
    return eight_sorted(passes ? key : number) & 7u;
#endif
}

// Push the children that the ray enters, the first to visit last. The boxes' near planes are known by the ray's direction, which gives the
// same interval as sorting them does (geometry/box.inc): rounding is monotonic. Returns the new top of the stack.
static int single_children(SingleRays* rays, int ray, int top, __global const float* node, int any_hit) {
    float8 near_at[3], far_at[3];
    #pragma unroll
    for (int k = 0; k < 3; ++k) {
        const float8 origin = (float8)(rays->origin[k][ray]), minus_inverse = (float8)(rays->minus_inverse[k][ray]);
        near_at[k] = (origin - vload8(0, node + rays->near_plane[k][ray])) * minus_inverse;
        far_at[k] = (origin - vload8(0, node + rays->far_plane[k][ray])) * minus_inverse;
    }
    float8 near, far;
    box_clip_pack(near_at[0], near_at[1], near_at[2], far_at[0], far_at[1], far_at[2], single_begin(rays, ray), &near, &far);
    const int8 passes = (near <= far) & (near <= rays->nearest[ray]) & single_reaches(rays, ray, far);

    const uint8 order = single_order(passes, near, any_hit);
    const uint8 references = as_uint8(vload8(0, node + BVH_CHILD)), enters = as_uint8(near);
    const ulong8 entries = convert_ulong8(eight_in_order(enters, order)) << 32 | convert_ulong8(eight_in_order(references, order));
    vstore8(entries, 0, rays->stack[ray] + top + 1);
    return top + count_of_eight(passes);
}

#ifdef INSTANCES
static void single_aim(SingleRays* rays, int ray, const float origin[3], const float direction[3]) {
    for (int k = 0; k < 3; ++k) {
        const float inverse = ray_inverse_one(direction[k]);
        rays->origin[k][ray] = origin[k];
        rays->direction[k][ray] = direction[k];
        rays->minus_inverse[k][ray] = -inverse;
        rays->near_plane[k][ray] = (inverse < 0.0f ? BVH_HIGH : BVH_LOW) + 8 * k;
        rays->far_plane[k][ray] = (inverse < 0.0f ? BVH_LOW : BVH_HIGH) + 8 * k;
    }
    rays->slack[ray] = ray_slack_one(direction[0], direction[1], direction[2]);
    rays->inverse2[ray] = ray_inverse2_one(direction[0], direction[1], direction[2]);
}

// A ray goes on in an instance: in its tree, or in the subtree below on the stack. Returns the new top of the stack.
static int single_enter(const Bvh* bvh, SingleRays* rays, int ray, int top, uint reference, float entered) {
    __global const float* row = bvh->instance_rows + (size_t)(reference & BVH_INDEX) * INSTANCE_WORDS;
    float o[3] = {rays->world[0][ray], rays->world[1][ray], rays->world[2][ray]};
    float d[3] = {rays->world[3][ray], rays->world[4][ray], rays->world[5][ray]};
#ifdef MOTION
    __global const uint* motion = bvh->instance_motions + INSTANCE_MOTION_WORDS * (size_t)(reference & BVH_INDEX);
    if (motion[1] > 0u) motion_back_one(bvh->motion_rows, motion[0], motion[1], rays->time[ray], o, d);
#endif
    float origin[3], direction[3];
    for (int k = 0; k < 3; ++k) {
        __global const float* m = row + INSTANCE_ROW_TO_OBJECT + k * 4;
        origin[k] = ray_carried_one(m[0], m[1], m[2], m[3], o[0], o[1], o[2]);
        direction[k] = ray_carried_one(m[0], m[1], m[2], 0.0f, d[0], d[1], d[2]);
    }
    single_aim(rays, ray, origin, direction);
    rays->start[ray] = entered;
    rays->triangle_offset[ray] = as_uint(row[INSTANCE_ROW_TRIANGLE_OFFSET]);
    rays->analytic_offset[ray] = as_uint(row[INSTANCE_ROW_ANALYTIC_OFFSET]);
#ifdef DEFORMATION
    rays->instance[ray] = reference & BVH_INDEX;
#endif
    if (!(reference & SINGLE_WITHIN)) rays->stack[ray][++top] = single_entry(as_uint(row[bvh->instance_root]), entered);
    rays->base[ray] = top;
    return top;
}

// And back in the world.
static void single_leave(SingleRays* rays, int ray) {
    const float origin[3] = {rays->world[0][ray], rays->world[1][ray], rays->world[2][ray]};
    const float direction[3] = {rays->world[3][ray], rays->world[4][ray], rays->world[5][ray]};
    single_aim(rays, ray, origin, direction);
    rays->start[ray] = BOX_START;
    rays->base[ray] = 0;
    rays->triangle_offset[ray] = rays->analytic_offset[ray] = 0;
#ifdef DEFORMATION
    rays->instance[ray] = NONE;
#endif
}
#endif

// The memory that the ray's next step reads, asked for a round before it is needed. In small trees it is near anyway.
static void single_prefetch(const Bvh* bvh, const SingleRays* rays, int ray) {
#ifdef BVH_PREFETCH
    uint next = (uint)rays->stack[ray][max(rays->top[ray], 0)];
#ifdef INSTANCES
    if (!(next & BVH_LEAF) && (next & BVH_INSTANCE)) next = 0;
#endif
    __global const float* pack = bvh_pack(bvh->triangle_packs, TRIANGLE_BLOCK_WORDS, next & BVH_ANALYTIC ? 0 : next);
    __global const float* node = bvh->nodes + (size_t)(next & BVH_INDEX) * BVH_NODE_WORDS;
    const size_t leaf = 0 - (size_t)(next >> 31);
    __global const float* at = (__global const float*)(((size_t)pack & leaf) | ((size_t)node & ~leaf));
    #pragma unroll
    for (int line = 0; line < TRIANGLE_BLOCK_WORDS / 16; ++line) prefetch_line(at + line * 16);
#endif
}

// Every ray through all that is on its stack. With any_hit a ray ends at its first occluder.
static void bvh_single(const Bvh* bvh, SingleRays* rays, int any_hit) {
    int queue[SINGLE_RAYS];
    int count = 0;
    for (int ray = 0; ray < SINGLE_RAYS; ++ray) {
        queue[count] = ray;
        count += rays->top[ray] >= 0 ? 1 : 0;
    }
    while (count > 0) {
        int left = 0;
        for (int i = 0; i < count; ++i) {
            const int ray = queue[i];
            int top = rays->top[ray];
#ifdef INSTANCES
            if (top < rays->base[ray]) single_leave(rays, ray);
#endif
            const ulong entry = rays->stack[ray][top--];
            const float entered = as_float((uint)(entry >> 32));
            const uint reference = (uint)entry;
            if (entered <= rays->nearest[ray]) {
#ifdef INSTANCES
                if (!(reference & BVH_LEAF) && (reference & BVH_INSTANCE))
                    top = single_enter(bvh, rays, ray, top, reference, entered);
                else
#endif
                if (!(reference & BVH_LEAF))
                    top = single_children(rays, ray, top, bvh->nodes + (size_t)reference * BVH_NODE_WORDS, any_hit);
                else if (reference & BVH_ANALYTIC)
                    single_analytic(rays, ray, bvh, reference, entered, any_hit);
                else
                    single_triangles(rays, ray, bvh, reference, entered, any_hit);
                if (any_hit && rays->nearest[ray] < 0.0f) top = -1;
            }
            rays->top[ray] = top;
            single_prefetch(bvh, rays, ray);
            queue[left] = ray;
            left += top >= 0 ? 1 : 0;
        }
        count = left;
    }
}

#endif
