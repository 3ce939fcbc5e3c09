// Entry points that find what each patch sees: form factors by rays.
#include "radiosity/patch.h"

// Rays are numbered row × rays + index; rows are the sides in use, `sides` tells which. With `listed`, ray n of the launch is
// list[first + n], else first + n. hits: the side met by each, or the number that stands for outside.
__kernel void radiosity_rays(SCENE_PARAMETERS __global const uint* sides, __global const uint* list, uint listed, uint first,
                             uint count, uint rays, __global uint* hits) {
    SCENE_COLLECT(scene);
    const uint base = (uint)get_global_id(0) * LANES;
    if (base >= count) return;
    uint number[LANES], side[LANES], index[LANES], met[LANES];
    int real[LANES];
    for (uint lane = 0; lane < LANES; ++lane) {
        real[lane] = base + lane < count;
        const uint n = first + (real[lane] ? base + lane : base);
        number[lane] = listed ? list[n] : n;
        side[lane] = sides[number[lane] / rays];
        index[lane] = number[lane] % rays;
    }
    const vmask active = lane_restore(real) != 0;
    const Ray ray = patch_ray(&scene, settings->seed, lane_restore(side), lane_restore(index));
    lane_store(patch_met(&scene, &ray, traverse_nearest(&scene.bvh, &ray, active)), met);
    for (uint lane = 0; lane < LANES; ++lane)
        if (real[lane]) hits[number[lane]] = met[lane];
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

// Which rays may meet something else after the sides [moved, moved_end) went from where they were to `box`: those that met them,
// those that pass the box, and their own.
__kernel void radiosity_affected(SCENE_PARAMETERS __global const uint* sides, uint first, uint count, uint rays, uint moved,
                                 uint moved_end, __global const float* box, __global const uint* hits, __global uchar* affected) {
    SCENE_COLLECT(scene);
    const uint base = (uint)get_global_id(0) * LANES;
    if (base >= count) return;
    uint side[LANES], index[LANES], met[LANES];
    int passes[LANES];
    for (uint lane = 0; lane < LANES; ++lane) {
        const uint n = first + min(base + lane, count - 1u);
        side[lane] = sides[n / rays];
        index[lane] = n % rays;
        met[lane] = hits[n];
    }
    const Ray ray = patch_ray(&scene, settings->seed, lane_restore(side), lane_restore(index));
    lane_store(patch_passes_box(&ray, box), passes);
    for (uint lane = 0; lane < LANES && base + lane < count; ++lane) {
        const int own = side[lane] >= moved && side[lane] < moved_end, lost = met[lane] >= moved && met[lane] < moved_end;
        affected[first + base + lane] = (uchar)(own || lost || passes[lane] != 0);
    }
}
