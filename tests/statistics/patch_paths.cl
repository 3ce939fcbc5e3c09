// Entry point of the path tracer with another camera: pixel i, row by row, sees patch i from just before it, at a point uniform by
// area. So the pixel's mean is the mean radiance of the patch.
#define CAMERA_CAMERA_H
#include "camera/shutter.h"
#include "radiosity/patch.h"

static Ray camera_ray(const Scene* scene, uint view, vfloat film_x, vfloat film_y, Sampler sampler, vfloat time) {
    const uint width = scene->settings->width, height = scene->settings->height;
    const vuint x = vuint_of(film_x * (float)width), y = vuint_of(film_y * (float)height);
    const vuint number = y * width + x, last = splat_uint(scene->settings->triangle_count - 1u);
    vfloat u, v;
    sampler_get(sampler, SET_LENS, &u, &v);
    const Surface s = patch_point(scene, (number < last ? number : last) * 2u, u, v);
    return ray_in_time(ray_make(along(s.point, s.normal, splat(1.0e-5f)), negate(s.normal)), time);
}

static vmask camera_sees(const Ray* ray) { return mask_all(); }

#include "integrator/path.h"

__kernel void patch_paths(SCENE_PARAMETERS uint first_slot, uint slot_count, uint first_sample, uint sample_count,
                          __global float* samples, __global uint4* stats) {
    SCENE_COLLECT(scene);
    Pool pool = pool_open(settings, samples, first_slot, slot_count, first_sample, sample_count);
    PoolStats counted = {0, 0, splat_uint(0u)};
    if (pool.base < slot_count) path_trace(&scene, &pool, &counted);
    stats[get_global_id(0)] = (uint4)(counted.rays, counted.shadow_rays, lane_largest_uint(counted.deepest), 0u);
}
