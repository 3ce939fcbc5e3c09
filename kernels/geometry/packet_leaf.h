// A leaf of the tree against the rays of all lanes: which of its primitives each ray hits, and whether that is the hit to keep.
#ifndef GEOMETRY_PACKET_LEAF_H
#define GEOMETRY_PACKET_LEAF_H

#include "geometry/holes.h"
#include "geometry/packet_ray.h"
#include "geometry/pose.h"

// Keep the hit where it is nearer; of equally near ones the lowest number, so that the order of visits does not matter: a hit with
// a lower number may be as far as the one that is kept, which is to be nearer than the next larger float. `entered` is where the
// rays enter the leaf's box, NEVER for those that do not. A ray that starts on one of [first, last] hits none of them, nor, in search of
// any hit, does one that is aimed at them. A distance that is not a number is never nearer.
static void packet_keep(const PacketRay* ray, vmask hit, vfloat distance, vfloat entered, vuint id, uint first, uint last,
                        int any_hit, vfloat* nearest, vuint* primitive) {
    const vfloat at = distance < entered ? entered : distance;
    const vuint one = any_hit ? splat_uint(1u) : (id < *primitive ? splat_uint(1u) : splat_uint(0u));
    const vfloat limit = vfloat_from_bits(vfloat_bits(*nearest) + one);
    const vuint most = splat_uint(last - first);
    const vmask other = BVH_PASSES_TARGET(any_hit) ? (ray->from - first > most) & (ray->to - first > most) : ray->from - first > most;
    const vmask keep = (hit & other) & packet_counts(ray, at, id) & (at < limit);
    *nearest = keep ? (any_hit ? splat(-1.0f) : at) : *nearest;
    if (!any_hit) *primitive = keep ? id : *primitive;
}

// The hits of a triangle or pair that count, as single_solid.
static vmask packet_solid(const Bvh* bvh, uint word, vmask hit, vmask near, vfloat determinant, vfloat b, vfloat c, int any_hit,
                          vuint* primitive) {
#ifdef HOLES
    if (bvh->hole_rows == 0 || !lane_any(hit & near)) return hit;
    int hits[LANES];
    uint doubtful[LANES];
    float determinants[LANES], weights_b[LANES], weights_c[LANES];
    lane_store((hit & near), hits);
    lane_store(*primitive, doubtful);
    lane_store(determinant, determinants);
    lane_store(b, weights_b);
    lane_store(c, weights_c);
    for (int lane = 0; lane < LANES; ++lane) {
        if (!hits[lane]) continue;
        const int known = holes_at(bvh, word, determinants[lane], weights_b[lane], weights_c[lane]);
        if (known == HOLES_HOLE || (any_hit && known == HOLES_UNKNOWN)) hits[lane] = 0;
        if (any_hit && known == HOLES_UNKNOWN) doubtful[lane] = 0u;
    }
    if (any_hit) *primitive = lane_restore(doubtful);
    return lane_restore(hits);
#else
    return hit;
#endif
}

#ifdef DEFORMATION
// The triangles of a mesh that changes its form, at each lane's time.
static void packet_deforming(PacketRay* ray, const Bvh* bvh, Poses poses, uint reference, vfloat entered, int any_hit) {
    __global const float* pack = bvh_pack(bvh->triangle_packs, TRIANGLE_BLOCK_WORDS, reference);
    const uint begin = as_uint(bvh->instance_rows[(size_t)ray->instance * INSTANCE_WORDS + 16 + PLACEMENT_ROW_FIRST]);
    for (uint left = bvh_members(reference); left > 0; --left, ++pack) {
        const uint first = (as_uint(pack[TRIANGLE_ID]) & ~BVH_NUMBER) + packet_triangle_offset(ray);
        vuint before, after;
        vfloat share, corners[9], t[15], determinant, b, c;
        pose_rows(bvh->motion_rows, splat_uint(poses.first + (first - begin)), splat_uint(poses.stride), splat_uint(poses.knots), ray->time,
                  &before, &after, &share);
        pose_numbers(bvh->motion_rows, before, after, share, corners);
        pose_triangle_lanes(corners, t);
        const vec3 from = sub(ray->origin, vec3_row(t, 0)), d = ray->direction;
        const vmask hit = triangle_hit_lanes(from.x, from.y, from.z, t[3], t[4], t[5], t[6], t[7], t[8], t[9], t[10], t[11], t[12], t[13], t[14],
                                             d.x, d.y, d.z, ray->slack, &determinant, &b, &c);
        const vfloat distance = triangle_distance_lanes(from.x, from.y, from.z, t[9], t[10], t[11], determinant);
#ifdef HOLES
        // Nothing is known of their holes
        if (any_hit && bvh->hole_rows != 0) {
            ray->primitive = hit & (distance <= ray->nearest) ? splat_uint(0u) : ray->primitive;
            continue;
        }
#endif
        packet_keep(ray, hit, distance, entered, splat_uint(first), first, first, any_hit, &ray->nearest, &ray->primitive);
    }
}
#endif

// Written without branches: whether any of the rays hits a triangle is a coin toss that no processor predicts.
static void packet_triangles(PacketRay* ray, const Bvh* bvh, uint reference, vfloat entered, int any_hit) {
#ifdef DEFORMATION
    if (ray->instance != NONE) {
        const Poses poses = poses_of(bvh, ray->instance);
        if (poses.knots > 0u) {
            packet_deforming(ray, bvh, poses, reference, entered, any_hit);
            return;
        }
    }
#endif
    __global const float* pack = bvh_pack(bvh->triangle_packs, TRIANGLE_BLOCK_WORDS, reference);
    vfloat nearest = ray->nearest;
    vuint primitive = ray->primitive;
    const uint offset = packet_triangle_offset(ray);
    for (uint left = bvh_members(reference); left > 0; --left, ++pack) {
        const uint word = as_uint(pack[TRIANGLE_ID]) & ~BVH_NUMBER, first = (word & ~BVH_PAIR) + offset, last = first + (word >> 31);
        const vec3 from = vec3_of(ray->origin.x - pack[0], ray->origin.y - pack[8], ray->origin.z - pack[16]);
        const vfloat nx = splat(pack[72]), ny = splat(pack[80]), nz = splat(pack[88]);
        vfloat determinant, b, c;
        const vec3 d = ray->direction;
        const vmask hit = triangle_hit_lanes(from.x, from.y, from.z, splat(pack[24]), splat(pack[32]), splat(pack[40]),
                                             splat(pack[48]), splat(pack[56]), splat(pack[64]), nx, ny, nz, splat(pack[96]),
                                             splat(pack[104]), splat(pack[112]), d.x, d.y, d.z, ray->slack, &determinant, &b, &c);
        const vfloat distance = triangle_distance_lanes(from.x, from.y, from.z, nx, ny, nz, determinant);
        vuint id = splat_uint(first);
        if (!any_hit && last != first) id = c > b ? splat_uint(last) : id;
        const vmask there = packet_solid(bvh, as_uint(pack[TRIANGLE_ID]), hit, distance <= nearest, determinant, b, c, any_hit, &primitive);
        packet_keep(ray, there, distance, entered, id, first, last, any_hit, &nearest, &primitive);
    }
    ray->nearest = nearest;
    ray->primitive = primitive;
}

#ifdef CURVES
// A curve, from whose ends others go on as `joints` tells. A ray that is aimed at one of them, through the hair that it is, passes this one.
static vmask packet_curve(const PacketRay* ray, const Bvh* bvh, __global const float* pack, vec3 from, uint kind, uint primitive, int any_hit,
                          vfloat* distance) {
    const uint joints = kind & (ANALYTIC_CURVE_BEFORE | ANALYTIC_CURVE_AFTER);
    const vfloat reach = splat(as_float(kind >> ANALYTIC_CURVE_REACH << 5));
    const vec3 o = ray->origin, d = ray->direction;
    const vmask near = curve_near_lanes(-from.x, -from.y, -from.z, splat(pack[32]), splat(pack[40]), splat(pack[48]), reach, d.x, d.y, d.z,
                                        ray->inverse2);
    *distance = splat(NEVER);
    if (!lane_any(near)) return near;
    __global const float* row = bvh->curve_rows + (size_t)(as_uint(pack[24]) & ~BVH_NUMBER) * CURVE_WORDS;
    vfloat k[CURVE_WORDS];
    for (int i = 0; i < CURVE_WORDS; ++i) k[i] = splat(row[i]);
    CurveHit_lanes found;
    vmask hit = near & curve_hit_lanes(k, o.x, o.y, o.z, d.x, d.y, d.z, ray->inverse2, packet_after(ray), &found);
    *distance = found.distance;
    const vmask begins = hit & (found.u <= 0.0f), ends = hit & (found.u >= 1.0f);
    float t[4];
    if ((joints & ANALYTIC_CURVE_BEFORE) && lane_any(begins)) {
        bvh_curve_slope(row - CURVE_WORDS, 1, t);
        hit = hit & (!begins | curve_shows_lanes(&found, splat(t[0]), splat(t[1]), splat(t[2]), splat(t[3]), 1.0f));
    }
    if ((joints & ANALYTIC_CURVE_AFTER) && lane_any(ends)) {
        bvh_curve_slope(row + CURVE_WORDS, 0, t);
        hit = hit & (!ends | curve_shows_lanes(&found, splat(t[0]), splat(t[1]), splat(t[2]), splat(t[3]), -1.0f));
    }
    const uint before = joints & ANALYTIC_CURVE_BEFORE, more = before + (joints >> 1);
    return BVH_PASSES_TARGET(any_hit) ? hit & (ray->to - (primitive - before) > splat_uint(more)) : hit;
}
#endif

// The rectangle in the pack's first column, square to the axis `a`, with sides along `u` and `v`.
#define PACKET_RECTANGLE(a, u, v)                                                                                           \
    rectangle_hit_lanes(from.a, -ray->inverse.a, from.u, from.v, ray->direction.u, ray->direction.v, splat(pack[24]),         \
                        splat(pack[32]), &distance, &place_u, &place_v)

static void packet_analytic(PacketRay* ray, const Bvh* bvh, uint reference, vfloat entered, int any_hit) {
    __global const float* pack = bvh_pack(bvh->analytic_packs, ANALYTIC_BLOCK_WORDS, reference);
    for (uint left = bvh_members(reference); left > 0; --left, ++pack) {
        const uint kind = as_uint(pack[ANALYTIC_KIND]) & ~BVH_NUMBER, word = as_uint(pack[ANALYTIC_ID]) & ~BVH_NUMBER;
        const uint first = (word & ~BVH_PAIR) + packet_analytic_offset(ray, kind), last = first + (word >> 31);
        const vec3 from = vec3_of(ray->origin.x - pack[0], ray->origin.y - pack[8], ray->origin.z - pack[16]);
        vuint id = splat_uint(first);
        vfloat distance;
        vmask hit;
#ifdef CURVES
        if (kind & ANALYTIC_CURVE)
            hit = packet_curve(ray, bvh, pack, from, kind, first, any_hit, &distance);
        else
#endif
        if (kind >= ANALYTIC_RECTANGLE) {
            vfloat place_u, place_v;
            if (kind == ANALYTIC_RECTANGLE)
                hit = PACKET_RECTANGLE(x, y, z);
            else if (kind == ANALYTIC_RECTANGLE + 1u)
                hit = PACKET_RECTANGLE(y, z, x);
            else
                hit = PACKET_RECTANGLE(z, x, y);
            if (!any_hit) id = rectangle_second_lanes(place_u, place_v, splat(pack[40]), splat(pack[48])) ? splat_uint(last) : id;
        } else {
            const vec3 to = negate(from), d = ray->direction;
            const vfloat radius = splat(pack[24]);
            if (kind == ANALYTIC_DISK)
                hit = disk_hit_lanes(to.x, to.y, to.z, radius, splat(pack[32]), splat(pack[40]), splat(pack[48]), d.x, d.y, d.z, &distance);
            else
                hit = sphere_hit_lanes(to.x, to.y, to.z, radius, d.x, d.y, d.z, ray->inverse2, packet_after(ray), &distance);
        }
#ifdef HOLES
        // Nothing is known of their holes
        if (any_hit && bvh->hole_rows != 0) {
            ray->primitive = hit & (distance <= ray->nearest) ? splat_uint(0u) : ray->primitive;
            continue;
        }
#endif
        packet_keep(ray, hit, distance, entered, id, first, last, any_hit, &ray->nearest, &ray->primitive);
    }
}

#endif
