// Whitted's ray tracing (1980): mirrors and glass are followed, a diffuse surface is lit from the centre of every light, and there
// the path ends. No indirect light and no soft shadows; the only thing left to chance is which way a ray leaves glass.
#ifndef INTEGRATOR_WHITTED_H
#define INTEGRATOR_WHITTED_H

#include "geometry/surface.h"
#include "integrator/path_state.h"
#include "light/light.h"
#include "material/bsdf.h"

static void whitted_trace(const Scene* scene, Pool* pool, PoolStats* stats) {
    __global const Settings* settings = scene->settings;
    CameraRays waiting = camera_rays_none();
    Path path = path_none();

    while (path_next(scene, pool, &waiting, &path)) {
        // Find the nearest surface and add the light it sends out, or the environment's
        const Hit hit = traverse_nearest(&scene->bvh, &path.ray, path.alive);
        stats->rays += lane_count(path.alive);
        stats->deepest = pool_deepest(stats->deepest, path.depth, path.alive);
        const vmask found = path.alive & (hit.primitive != NONE);
        const Surface surface = surface_at(scene, &path.ray, hit, found);
        vfloat pdf;
        const vec3 outside = light_environment(scene, path.ray.origin, path.ray.direction, &pdf);
        const vec3 shining = light_emitted(scene, &surface, path.ray.origin, path.ray.direction, &pdf);
        const vec3 seen = mul(path.throughput, choose(found, shining, outside));
        path.radiance = choose(path.alive, add(path.radiance, seen), path.radiance);

        // Light a diffuse surface from the centre of every light that nothing hides
        const Bsdf bsdf = bsdf_at(&surface, path.ray.direction);
        const vmask may_scatter = found & (path.depth < settings->max_depth);
        const vmask lit = may_scatter & bsdf.smooth;
        if (lane_any(lit)) {
            for (uint number = 0; number < settings->light_count; ++number) {
                const LightSample light = light_from_center(scene, surface.point, splat_uint(number));
                const vec3 direct = mul(bsdf_eval(&bsdf, light.direction, &pdf), light.radiance);
                const vmask asked = lit & (light.pdf > 0.0f) & (largest(direct) > 0.0f);
                const Ray shadow_ray = light_shadow_ray(&surface, &light);
                const vmask blocked = traverse_occluded(&scene->bvh, &shadow_ray, asked);
                stats->shadow_rays += lane_count(asked);
                path.radiance = choose(asked & !blocked, add(path.radiance, mul(path.throughput, direct)), path.radiance);
                stats->deepest = pool_deepest(stats->deepest, path.depth + 1u, asked);
            }
        }

        // Follow mirrors and glass
        vuint bits_u, bits_v;
        sampler_bounce_bits(path.sample.sampler, SET_MATERIAL, path.depth, &bits_u, &bits_v);
        const BsdfSample next = bsdf_sample(&bsdf, bits_u, bits_v);
        path.throughput = mul(path.throughput, next.weight);
        path.depth = path.depth + 1u;
        path.ray = surface_leave(&surface, next.direction);
        const vmask ended = path.alive & !(may_scatter & !bsdf.smooth & (largest(path.throughput) > 0.0f));
        if (lane_any(ended)) pool_deliver(pool, &path.sample, path.radiance, ended);
        path.alive = path.alive & !ended;
    }
}

#endif
