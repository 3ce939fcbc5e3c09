// Entry points that find what each patch sees: form factors by rays.
#include "radiosity/patch.h"

// Side and index of the ray in each lane, for LANES rays from number `n` on, of which `left` are real; the others repeat the first.
// Where rows are a multiple of LANES, and `n` too, all lanes have the same side, and need no division each.
static void form_number(__global const uint* sides, uint n, uint left, uint rays, vuint* side, vuint* index) {
    if (rays % LANES == 0u && n % LANES == 0u) {
        const uint row = n / rays;
        *side = splat_uint(sides[row]);
        *index = lane_index() + (n - row * rays);
        return;
    }
    uint at[LANES], k[LANES];
    for (uint lane = 0; lane < LANES; ++lane) {
        const uint number = n + (lane < left ? lane : 0u), row = number / rays;
        at[lane] = sides[row];
        k[lane] = number - row * rays;
    }
    *side = lane_restore(at);
    *index = lane_restore(k);
}

// Rays are numbered row × rays + index; rows are the sides in use, `sides` tells which. hits: the side met by each, or the number
// that stands for outside.
__kernel void radiosity_rays(SCENE_PARAMETERS __global const uint* sides, uint first, uint count, uint rays, __global uint* hits) {
    SCENE_COLLECT(scene);
    const uint base = (uint)get_global_id(0) * LANES;
    if (base >= count) return;
    uint met[LANES];
    vuint side, index;
    form_number(sides, first + base, count - base, rays, &side, &index);
    const vmask active = lane_index() < count - base;
    const Ray ray = patch_ray(&scene, settings->seed, side, index);
    lane_store(patch_met(&scene, &ray, traverse_nearest(&scene.bvh, &ray, active)), met);
    for (uint lane = 0; lane < LANES && base + lane < count; ++lane) hits[first + base + lane] = met[lane];
}

// The same with rays through the cells of a hemicube about the side's centre (Cohen & Greenberg 1985); `cells`: a direction for
// each, in the frame of the normal.
__kernel void radiosity_hemicube(SCENE_PARAMETERS __global const uint* sides, __global const float4* cells, uint first, uint count,
                                 uint rays, __global uint* hits) {
    SCENE_COLLECT(scene);
    const uint base = (uint)get_global_id(0) * LANES;
    if (base >= count) return;
    uint side[LANES], met[LANES];
    int real[LANES];
    float x[LANES], y[LANES], z[LANES];
    for (uint lane = 0; lane < LANES; ++lane) {
        real[lane] = base + lane < count;
        const uint n = first + (real[lane] ? base + lane : base);
        const float4 cell = cells[n % rays];
        side[lane] = sides[n / rays];
        x[lane] = cell.x, y[lane] = cell.y, z[lane] = cell.z;
    }
    const vmask active = lane_restore(real) != 0;
    // warp_triangle(2/3, 2/3) is the centre
    const Surface s = patch_point(&scene, lane_restore(side), splat(0.66666667f), splat(0.66666667f));
    const vec3 through = vec3_of(lane_restore(x), lane_restore(y), lane_restore(z));
    const Ray ray = surface_leave(&s, unit(frame_to_world(frame_around(s.normal), through)));
    lane_store(patch_met(&scene, &ray, traverse_nearest(&scene.bvh, &ray, active)), met);
    for (uint lane = 0; lane < LANES; ++lane)
        if (real[lane]) hits[first + base + lane] = met[lane];
}
