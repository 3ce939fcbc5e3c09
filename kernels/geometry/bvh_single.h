// One ray through the tree: against the eight boxes of a node or the eight members of a pack at a time.
#ifndef GEOMETRY_BVH_SINGLE_H
#define GEOMETRY_BVH_SINGLE_H

#include "geometry/bvh.h"
#include "geometry/wide.h"
#include "types.h"

typedef struct {
    float origin[3], direction[3], inverse[3], slack, inverse2;
    uint from, to;
    float nearest;       // distance of the nearest hit so far; negative once an occluder was found
    uint primitive;      // its number
} SingleRay;

static int any_of_eight(int8 m) { return as_long(convert_char8(m)) != 0; }

// Keep the nearest of the pack's hits; of equally near ones the lowest number, so that the order of visits does not matter.
// `entered` is where the ray enters the leaf's box, `later` where it hits the second of a pair.
static void single_keep(SingleRay* ray, int8 hit, int8 later, float8 distance, float entered, __global const float* ids,
                        int any_hit) {
    float at[8];
    int hits[8], seconds[8];
    const float8 clamped = distance < entered ? (float8)(entered) : distance;
    vstore8(clamped, 0, at);
    vstore8(later, 0, seconds);
    vstore8(hit & (clamped > BOX_START) & (clamped <= ray->nearest), 0, hits);
    for (int i = 0; i < 8; ++i) {
        if (!hits[i]) continue;
        const uint word = as_uint(ids[i]);
        const uint first = word & ~BVH_PAIR, pair = word >> 31;
        if (word == NONE || ray->from - first <= pair || ray->to - first <= pair) continue;
        const uint id = first + (seconds[i] ? pair : 0u);
        if (at[i] < ray->nearest || (at[i] == ray->nearest && id < ray->primitive)) {
            ray->nearest = any_hit ? -1.0f : at[i];
            ray->primitive = id;
        }
    }
}

static void single_triangles(SingleRay* ray, __global const float* pack, float entered, int any_hit) {
    const float8 from_x = ray->origin[0] - vload8(0, pack), from_y = ray->origin[1] - vload8(1, pack);
    const float8 from_z = ray->origin[2] - vload8(2, pack);
    const float8 nx = vload8(9, pack), ny = vload8(10, pack), nz = vload8(11, pack);
    float8 determinant, b, c;
    const int8 hit = triangle_hit_pack(from_x, from_y, from_z, vload8(3, pack), vload8(4, pack), vload8(5, pack), vload8(6, pack),
                                       vload8(7, pack), vload8(8, pack), nx, ny, nz, vload8(12, pack), vload8(13, pack),
                                       vload8(14, pack), (float8)(ray->direction[0]), (float8)(ray->direction[1]),
                                       (float8)(ray->direction[2]), (float8)(ray->slack), &determinant, &b, &c);
    if (!any_of_eight(hit)) return;
    const float8 distance = triangle_distance_pack(from_x, from_y, from_z, nx, ny, nz, determinant);
    single_keep(ray, hit, c > b, distance, entered, pack + TRIANGLE_PACK_ID, any_hit);
}

static void single_rounds(SingleRay* ray, __global const float* pack, float entered, int any_hit) {
    const float8 cx = vload8(0, pack), cy = vload8(1, pack), cz = vload8(2, pack), radius = vload8(3, pack);
    const float8 nx = vload8(4, pack), ny = vload8(5, pack), nz = vload8(6, pack);
    const float8 dx = (float8)(ray->direction[0]), dy = (float8)(ray->direction[1]), dz = (float8)(ray->direction[2]);
    const float8 to_x = cx - ray->origin[0], to_y = cy - ray->origin[1], to_z = cz - ray->origin[2];
    const int8 disk = (nx != 0.0f) | (ny != 0.0f) | (nz != 0.0f);
    float8 sphere_distance, disk_distance;
    const int8 sphere = sphere_hit_pack(to_x, to_y, to_z, radius, dx, dy, dz, (float8)(ray->inverse2), &sphere_distance);
    const int8 flat = disk_hit_pack(to_x, to_y, to_z, radius, nx, ny, nz, dx, dy, dz, &disk_distance);
    const int8 hit = disk ? flat : sphere;
    if (!any_of_eight(hit)) return;
    single_keep(ray, hit, (int8)(0), disk ? disk_distance : sphere_distance, entered, pack + ROUND_PACK_ID, any_hit);
}

// Everything below `start`, whose box the ray enters at `entered`, nearest boxes first. With any_hit it ends at the first occluder.
static void bvh_single(const Bvh* bvh, SingleRay* ray, uint start, float start_entered, int any_hit) {
    uint stack[BVH_STACK];
    float stack_near[BVH_STACK];
    int top = 0;
    stack[0] = start;
    stack_near[0] = start_entered;
    while (top >= 0) {
        const uint reference = stack[top];
        const float entered = stack_near[top];
        --top;
        if (entered > ray->nearest) continue;
        if (reference & BVH_LEAF) {
            const size_t index = reference & BVH_INDEX;
            if (reference & BVH_ROUND)
                single_rounds(ray, bvh->round_packs + index * ROUND_PACK_WORDS, entered, any_hit);
            else
                single_triangles(ray, bvh->triangle_packs + index * TRIANGLE_PACK_WORDS, entered, any_hit);
            continue;
        }
        __global const float* node = bvh->nodes + (size_t)reference * BVH_NODE_WORDS;
        float8 near, far;
        box_interval_pack(vload8(0, node) - ray->origin[0], vload8(1, node) - ray->origin[1], vload8(2, node) - ray->origin[2],
                          vload8(3, node) - ray->origin[0], vload8(4, node) - ray->origin[1], vload8(5, node) - ray->origin[2],
                          (float8)(ray->inverse[0]), (float8)(ray->inverse[1]), (float8)(ray->inverse[2]), &near, &far);
        const int8 passed = (near <= far) & (near <= ray->nearest);
        if (!any_of_eight(passed)) continue;
        int passes[8];
        float nears[8];
        vstore8(passed, 0, passes);
        vstore8(near, 0, nears);
        const int floor_of_node = top;
        for (int i = 0; i < 8; ++i) {
            if (!passes[i]) continue;
            const uint child = as_uint(node[BVH_CHILD + i]);
            if (child == BVH_EMPTY) break;
            int slot = ++top;
            while (slot - 1 > floor_of_node && stack_near[slot - 1] < nears[i]) {
                stack[slot] = stack[slot - 1];
                stack_near[slot] = stack_near[slot - 1];
                --slot;
            }
            stack[slot] = child;
            stack_near[slot] = nears[i];
        }
    }
}

#endif
