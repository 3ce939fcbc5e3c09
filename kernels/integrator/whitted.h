// Whitted's ray tracing (1980): mirrors and glass are followed, a diffuse surface is lit from the centre of every light, and there
// the path ends. No indirect light and no soft shadows; the only thing left to chance is which way a ray leaves glass.
#ifndef INTEGRATOR_WHITTED_H
#define INTEGRATOR_WHITTED_H

#include "camera/perspective.h"
#include "film/pool.h"
#include "geometry/surface.h"
#include "light/light.h"
#include "material/bsdf.h"

static void whitted_trace(const Scene* scene, Pool* pool, PoolStats* stats) {
    __global const Settings* settings = scene->settings;
    PoolSample sample = pool_no_sample();
    Ray ray;
    vec3 throughput = vec3_all(0.0f), radiance = vec3_all(0.0f);
    vuint depth = splat_uint(0u);
    vmask alive = depth != depth;
    ray.origin = ray.direction = vec3_all(1.0f);
    ray.limit = splat(FAR);
    ray.from = ray.to = splat_uint(NONE);

    for (;;) {
        // Lanes without a ray take the next sample of the pool
        if (lane_any(!alive)) {
            const vmask start = pool_take(settings, pool, !alive, &sample);
            vfloat film_x, film_y;
            pool_film(settings, &sample, &film_x, &film_y);
            ray_replace(&ray, perspective_ray(scene, film_x, film_y, sample.sampler), start);
            throughput = choose(start, vec3_all(1.0f), throughput);
            radiance = choose(start, vec3_all(0.0f), radiance);
            depth = start ? splat_uint(0u) : depth;
            alive = alive | start;
            if (!lane_any(alive)) {
                if (pool_empty(pool)) break;
                continue;
            }
        }

        // Find the nearest surface and add the light it sends out, or the environment's
        const Hit hit = traverse_nearest(&scene->bvh, &ray, alive);
        stats->rays += lane_count(alive);
        stats->deepest = pool_deepest(stats->deepest, depth, alive);
        const vmask found = alive & (hit.primitive != NONE);
        const Surface surface = surface_at(scene, &ray, hit, found);
        vfloat pdf;
        const vec3 outside = light_environment(scene, ray.origin, ray.direction, &pdf);
        const vec3 shining = light_emitted(scene, &surface, ray.origin, ray.direction, &pdf);
        const vec3 seen = mul(throughput, choose(found, shining, outside));
        radiance = choose(alive, add(radiance, seen), radiance);

        // Light a diffuse surface from the centre of every light that nothing hides
        const Bsdf bsdf = bsdf_at(&surface, ray.direction);
        const vmask may_scatter = found & (depth < settings->max_depth);
        const vmask lit = may_scatter & bsdf.smooth;
        if (lane_any(lit)) {
            for (uint number = 0; number < settings->light_count; ++number) {
                const LightSample light = light_from_center(scene, surface.point, splat_uint(number));
                const vec3 direct = mul(bsdf_eval(&bsdf, light.direction, &pdf), light.radiance);
                const vmask asked = lit & (light.pdf > 0.0f) & (largest(direct) > 0.0f);
                const Ray shadow_ray = light_shadow_ray(&surface, &light);
                const vmask blocked = traverse_occluded(&scene->bvh, &shadow_ray, asked);
                stats->shadow_rays += lane_count(asked);
                radiance = choose(asked & !blocked, add(radiance, mul(throughput, direct)), radiance);
                stats->deepest = pool_deepest(stats->deepest, depth + 1u, asked);
            }
        }

        // Follow mirrors and glass
        vuint bits_u, bits_v;
        sampler_bounce_bits(sample.sampler, SET_MATERIAL, depth, &bits_u, &bits_v);
        const BsdfSample next = bsdf_sample(&bsdf, bits_u, bits_v);
        throughput = mul(throughput, next.weight);
        depth = depth + 1u;
        ray = surface_leave(&surface, next.direction);
        const vmask ended = alive & !(may_scatter & !bsdf.smooth & (largest(throughput) > 0.0f));
        if (lane_any(ended)) pool_deliver(pool, &sample, radiance, ended);
        alive = alive & !ended;
    }
}

#endif
