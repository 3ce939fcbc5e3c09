// Entry points that follow a move: which rays may meet something else now, what, and what that changes.
#include "radiosity/moving.h"

#define TRACED 0x80000000u
// What a side is to others' rays.
#define SIDE_SEALED 1u
#define SIDE_UNKNOWN 2u

// For each row from `first` on how many of its rays there are to look at, and a bit for each: those of the shape that moved, those
// that met it, and those on whose way from patch to patch it may now be. bits: `words` for each row.
__kernel void radiosity_mark(SCENE_PARAMETERS MOVING_PARAMETERS __global const uint* sides, uint first, uint count, uint rays,
                             uint words, __global const uint* hits, __global uint* bits, __global uint* counts) {
    SCENE_COLLECT(scene);
    MOVING_COLLECT(moving);
    if ((uint)get_global_id(0) >= count) return;
    const uint row = first + (uint)get_global_id(0), outside = settings->primitive_count * 2u;
    __global const uint* met = hits + (size_t)row * rays;
    const vuint side = splat_uint(sides[row]);
    const int own = sides[row] - moved < moved_end - moved;
    const PatchBox from = moving_patch_box(&scene, side);
    uint word = 0u, total = 0u;
    for (uint k = 0; k < rays; k += LANES) {
        uint before[LANES], bit[LANES];
        for (uint lane = 0; lane < LANES; ++lane) before[lane] = met[min(k + lane, rays - 1u)];
        const vuint old = lane_restore(before);
        vmask marked = (k + lane_index() < rays) & (moving_has(&moving, old) | (old >= outside));
        if (own) marked = k + lane_index() < rays;
        else {
            const PatchBox to = moving_patch_box(&scene, old >= outside ? side : old);
            marked = marked | ((k + lane_index() < rays) & moving_between(&from, &to, place + MOVING_AFTER));
        }
        if (lane_any(marked)) {
            lane_store((marked ? splat_uint(1u) << ((k + lane_index()) & 31u) : splat_uint(0u)), bit);
            for (uint lane = 0; lane < LANES; ++lane) word |= bit[lane];
        }
        if ((k + LANES) % 32u == 0u || k + LANES >= rays) {
            bits[(size_t)row * words + k / 32u] = word;
            total += popcount(word);
            word = 0u;
        }
    }
    counts[row] = total;
}

// The numbers of those rays, row x rays + index, each row's from its place on.
__kernel void radiosity_list(__global const uint* bits, __global const uint* places, uint rows, uint rays, uint words,
                             __global uint* list) {
    const uint row = (uint)get_global_id(0);
    if (row >= rows) return;
    uint to = places[row];
    for (uint k = 0; k < words; ++k)
        for (uint word = bits[(size_t)row * words + k]; word != 0u; word &= word - 1u)
            list[to++] = row * rays + k * 32u + popcount((word & -word) - 1u);
}

// How far along the ray the plane of the patch is that it met, `back` by so much; FAR where it met nothing, below 0 where it cannot be told.
static vfloat update_distance(const Scene* scene, const Ray* ray, vuint met, vec3 back) {
    const vmask found = met < patch_outside(scene);
    vfloat row[16];
    lane_rows(scene->primitive_rows, found ? met >> 1 : splat_uint(0u), row);
    const vec3 a = vec3_row(row, PRIMITIVE_ROW_A);
    const vec3 normal = unit(outer(sub(vec3_row(row, PRIMITIVE_ROW_B), a), sub(vec3_row(row, PRIMITIVE_ROW_C), a)));
    const vfloat slope = inner(ray->direction, normal), height = inner(sub(sub(a, back), ray->origin), normal);
    const vmask sure = found & (absolute(slope) > 1.0e-6f);
    return sure ? quotient(height, sure ? slope : splat(1.0f)) : (found ? splat(-1.0f) : splat(FAR));
}

// What rays meet now that met `before`. Those from the shape that moved, and those that met it, are followed through everything, but
// what has not moved is not where a ray went before; others only to the shape. Gives those that had to be followed at all.
static vuint update_met(const Scene* scene, const Moving* moving, const Ray* ray, vuint side, vuint before, vmask active,
                        vmask* traced) {
    __global const float* step = moving->place + MOVING_STEP;
    const vmask own = moving_has(moving, side), lost = moving_has(moving, before);
    const vmask away = own & ((side & 1u) == 0u) & (splat_uint(moving->convex) != 0u);
    const vec3 back = choose(lost, vec3_of(splat(step[0]), splat(step[1]), splat(step[2])), vec3_all(0.0f));
    const vfloat way = update_distance(scene, ray, before, back);
    const vmask anew = own | lost | (way < 0.0f);
    Hit hit;
    vmask found = mask_none(), asked = active & (anew | moving_passes_box(ray, moving->place + MOVING_AFTER));
    *traced = asked;
    Ray other = moving_ray(moving, ray);
    other.limit = anew ? ray->limit : way;
    Bvh tree = moving->tree;
    for (uint turn = 0; turn < 2; ++turn) {
        const vmask walks = turn == 0 ? asked & !away : asked;
        const Hit next = traverse_nearest(&tree, &other, walks);
        const vmask better = walks & (next.primitive != NONE);
        if (turn == 0) hit = next;
        hit.primitive = better ? next.primitive : hit.primitive;
        hit.distance = better ? next.distance : hit.distance;
        found = found | better;
        asked = active & anew & !(!own & found & (hit.distance < way * 0.9999f));
        if (!lane_any(asked)) break;
        other = *ray;
        other.limit = found ? hit.distance : ray->limit;
        tree = scene->bvh;
    }
    hit.primitive = found ? hit.primitive : splat_uint(NONE);
    const vuint now = patch_met(scene, ray, hit);
    return found | anew ? now : before;
}

// Those rays again, from number `first` of the list on. was: what they met before, with TRACED where they had to be followed.
__kernel void radiosity_listed(SCENE_PARAMETERS MOVING_PARAMETERS __global const uint* sides, __global const uint* list, uint first,
                               uint count, uint rays, __global uint* hits, __global uint* was) {
    SCENE_COLLECT(scene);
    MOVING_COLLECT(moving);
    const uint base = (uint)get_global_id(0) * LANES;
    if (base >= count) return;
    uint at[LANES], index[LANES], met[LANES], old[LANES];
    int asked[LANES];
    for (uint lane = 0; lane < LANES; ++lane) {
        const uint number = list[first + min(base + lane, count - 1u)], row = number / rays;
        at[lane] = sides[row];
        index[lane] = number - row * rays;
        old[lane] = hits[number];
    }
    const vmask active = lane_index() < count - base;
    const vuint side = lane_restore(at);
    const Ray ray = patch_ray(&scene, settings->seed, side, lane_restore(index));
    vmask traced;
    lane_store(update_met(&scene, &moving, &ray, side, lane_restore(old), active, &traced), met);
    lane_store(traced, asked);
    for (uint lane = 0; lane < LANES && base + lane < count; ++lane) {
        hits[list[first + base + lane]] = met[lane];
        was[first + base + lane] = old[lane] | (asked[lane] ? TRACED : 0u);
    }
}

// What that changes for each row: the sum over its rays of what they bring, now less before, in the order of the rays; how many were
// followed, how many more set out from under something, and how many meet a side that nobody met before. places: one more than rows.
__kernel void radiosity_changes(__global const uint* list, __global const uint* was, __global const uint* hits,
                                __global const uint* places, uint rows, __global const float4* sent, __global const uchar* kinds,
                                __global float4* changes, __global int4* counts) {
    const uint row = (uint)get_global_id(0);
    if (row >= rows) return;
    float4 change = (float4)(0.0f);
    int4 sum = (int4)(0);
    for (uint i = places[row]; i < places[row + 1]; ++i) {
        const uint now = hits[list[i]], before = was[i] & ~TRACED;
        sum.x += was[i] & TRACED ? 1 : 0;
        if (now == before) continue;
        change = change + (sent[now] - sent[before]);
        sum.y += (kinds[now] == SIDE_SEALED) - (kinds[before] == SIDE_SEALED);
        sum.z += kinds[now] == SIDE_UNKNOWN;
    }
    changes[row] = change;
    counts[row] = sum;
}
