// What a path carries from one surface to the next, in every lane, and how it begins.
#ifndef INTEGRATOR_PATH_STATE_H
#define INTEGRATOR_PATH_STATE_H

#include "camera/perspective.h"
#include "film/pool.h"

typedef struct {
    vmask alive;
    PoolSample sample;       // which one of the pool, and its random numbers
    Ray ray;                 // the next segment
    vec3 throughput;         // what the camera gets of the radiance arriving along it
    vec3 radiance;           // found so far
    vuint depth;             // scattering events so far
    vec3 normal;             // of the last surface, on the side that the ray left from
    vfloat material_pdf;     // density of the ray's direction times the number of such rays; 0 from the camera or a delta
    vmask diffused;          // it has met a surface that is not a delta
} Path;

// No lane has a path. All is set all the same: a lane without one computes along, and must do so without harm.
static Path path_none(void) {
    Path path;
    path.alive = path.diffused = splat_uint(0u) != splat_uint(0u);
    path.depth = splat_uint(0u);
    path.material_pdf = splat(0.0f);
    path.throughput = path.radiance = path.normal = vec3_all(0.0f);
    path.ray.origin = vec3_all(0.0f);
    path.ray.direction = vec3_all(1.0f);
    path.ray.limit = splat(FAR);
    path.ray.from = path.ray.to = splat_uint(NONE);
    path.sample = pool_no_sample();
    return path;
}

static void path_start(const Scene* scene, vmask start, Path* path) {
    vfloat film_x, film_y;
    pool_film(scene->settings, &path->sample, &film_x, &film_y);
    ray_replace(&path->ray, perspective_ray(scene, film_x, film_y, path->sample.sampler), start);
    path->throughput = choose(start, vec3_all(1.0f), path->throughput);
    path->radiance = choose(start, vec3_all(0.0f), path->radiance);
    path->depth = start ? splat_uint(0u) : path->depth;
    path->material_pdf = start ? splat(0.0f) : path->material_pdf;
    path->diffused = path->diffused & !start;
    path->alive = path->alive | start;
}

// Lanes without a path take the next sample of the pool. Returns whether any lane has one: if not, the pool is used up.
static int path_next(const Scene* scene, Pool* pool, Path* path) {
    while (lane_any(!path->alive)) {
        const vmask started = pool_take(scene->settings, pool, !path->alive, &path->sample);
        if (lane_any(started)) path_start(scene, started, path);
        if (lane_any(path->alive)) return 1;
        if (pool_empty(pool)) return 0;
    }
    return 1;
}

#endif
