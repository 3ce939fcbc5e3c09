// Rays of a camera through given points of the film, and how it sees given points of the scene.
#include "camera/camera.h"
#include "camera/towards.h"

static Scene cameras_scene(__global const Camera* camera, __global const Settings* settings) {
    Scene scene;
    scene.camera = camera;
    scene.settings = settings;
    return scene;
}

// places: float [2][count], of the film. results: float [8][count], origin, direction, limit, and pixels per steradian.
__kernel void cameras_rays(__global const Camera* camera, __global const Settings* settings, __global const float* places, uint count,
                           __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const Scene scene = cameras_scene(camera, settings);
    const Sampler sampler = sampler_start(1u, lane_index() + (uint)at, splat_uint(0u));
    const Ray ray = camera_ray(&scene, 0u, lane_load(places + at), lane_load(places + count + at), sampler, splat(0.0f));
    lane_save(ray.origin.x, results + at);
    lane_save(ray.origin.y, results + count + at);
    lane_save(ray.origin.z, results + 2 * (size_t)count + at);
    lane_save(ray.direction.x, results + 3 * (size_t)count + at);
    lane_save(ray.direction.y, results + 4 * (size_t)count + at);
    lane_save(ray.direction.z, results + 5 * (size_t)count + at);
    lane_save(ray.limit, results + 6 * (size_t)count + at);
    lane_save(camera_density(&scene, ray.origin, ray.direction, splat(0.0f)), results + 7 * (size_t)count + at);
}

// points: float [3][count]. results: float [3][count], the place on the film, and pixels per square metre seen head-on.
__kernel void cameras_towards(__global const Camera* camera, __global const Settings* settings, __global const float* points, uint count,
                              __global float* results) {
    const size_t at = get_global_id(0) * LANES;
    if (at >= count) return;
    const Scene scene = cameras_scene(camera, settings);
    const vec3 point = vec3_of(lane_load(points + at), lane_load(points + count + at), lane_load(points + 2 * (size_t)count + at));
    const CameraView view = camera_towards(&scene, point, splat(0.3f), splat(0.6f), splat(0.0f));
    lane_save(view.film_x, results + at);
    lane_save(view.film_y, results + count + at);
    lane_save(view.density, results + 2 * (size_t)count + at);
}
