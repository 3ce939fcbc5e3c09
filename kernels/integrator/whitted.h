// Whitted's ray tracing (1980): mirrors and glass are followed, a diffuse surface is lit from the centre of every light, and there
// the path ends. No indirect light and no soft shadows; the only thing left to chance is which way a ray leaves glass.
#ifndef INTEGRATOR_WHITTED_H
#define INTEGRATOR_WHITTED_H

#include "core/roulette.h"
#include "geometry/find.h"
#include "geometry/surface.h"
#include "geometry/terminator.h"
#include "integrator/inspect.h"
#include "integrator/path_state.h"
#include "light/light.h"
#include "material/bsdf.h"
#include "material/interior.h"

#ifdef PATH_INSPECTED
#define WHITTED_RECORDS , __global uint* records
#else
#define WHITTED_RECORDS
#endif

static void whitted_trace(const Scene* given, Pool* pool, PoolStats* stats WHITTED_RECORDS) {
    Scene here = *given;
    const Scene* scene = &here;
    __global const Settings* settings = scene->settings;
    CameraRays waiting = camera_rays_none();
    Path path = path_none();
#ifdef PATH_INSPECTED
    path.inspection = inspection_of(records);
#endif

    while (path_next(scene, pool, &waiting, &path)) {
        scene_at_wavelengths(&here, path.sample.sampler, splat_uint(0u));
        scene_choose_wavelength(&here, path.sample.sampler, path.depth, path.throughput);

        // Find the nearest surface and add the light it sends out, or the environment's
        const Hit hit = find_nearest(scene, &path.ray, path.sample.sampler, path.depth, path.depth == 0u, path.alive);
        stats->rays += lane_count(path.alive);
        stats->deepest = pool_deepest(stats->deepest, path.depth, path.alive);
        const vmask found = path.alive & (hit.primitive != NONE);
        Surface surface = surface_at(scene, &path.ray, hit, found);
        terminator_offset(scene, &surface, found);
        const Crossing crossing = interior_meet(scene, &path.interior, &surface, found);
        const vmask straight = interior_straight(&crossing);
        path.throughput = interior_absorb(scene, &path.interior, &path.ray, hit, path.alive, path.throughput);
        const vmask escapes = path.alive & !found & !environment_hidden(scene, path.depth);
        vec3 outside = vec3_all(0.0f);
        if (lane_any(escapes)) outside = choose(escapes, environment_emitted(scene, path.ray.direction, escapes), outside);
        const vec3 seen = mul(path.throughput, choose(found, light_emitted(scene, &surface, found), outside));
        path.radiance = choose(path.alive, add(path.radiance, seen), path.radiance);

        // Light a diffuse surface from the centre of every light that nothing hides
        Bsdf bsdf;
        bsdf_at(scene, &surface, path.ray.direction, &bsdf);
        inspect_whitted(scene, &path, hit, found, escapes, &surface, &bsdf, straight, found & ((path.depth < settings->max_depth) | straight), seen);
#if defined(SPECTRAL) && defined(DISPERSION)
        path.throughput = color_alone(scene, path.throughput, found & bsdf.disperses & !straight);
#endif
        const vmask may_scatter = found & ((path.depth < settings->max_depth) | straight);
        const vmask lit = may_scatter & !(bsdf.specular | straight);
        if (lane_any(lit)) {
            vfloat unused;
            for (uint number = 0; number < settings->light_count; ++number) {
                const LightSample light = light_from_center(scene, surface.point, surface.primitive, splat_uint(number), surface_time(&surface));
                const vfloat distance = magnitude(sub(light.target, surface.point));
                const Interior in = interior_towards(&path.interior, &crossing, light.direction, bsdf.side);
                const vec3 left_on_way = interior_transmittance(scene, &in, surface.point, light.direction, distance, light.infinite, lit);
                const vec3 arriving = mul(light.radiance, left_on_way);
                const vec3 direct = mul(bsdf_eval(&bsdf, light.direction, &unused), arriving);
                const vmask asked = lit & (light.pdf > 0.0f) & (largest(direct) > 0.0f);
                const Ray shadow_ray = light_shadow_ray(&surface, &light);
                const vfloat left = passage_of(scene, &shadow_ray, asked);
                stats->shadow_rays += lane_count(asked);
                inspect_center(scene, &path, &surface, number, &light, direct, asked, left);
                path.radiance = choose(asked & (left > 0.0f), add(path.radiance, scale(mul(path.throughput, direct), left)), path.radiance);
                stats->deepest = pool_deepest(stats->deepest, path.depth + 1u, asked);
            }
        }

        // Follow mirrors and glass, but not for ever
        vuint bits_u, bits_v;
        sampler_bits(path.sample.sampler, sampler_set(path.depth, SET_BSDF), &bits_u, &bits_v);
        BsdfSample next = bsdf_sample(&bsdf, bits_u, bits_v);
        interior_straighten(&crossing, path.ray.direction, &next.direction, &next.weight);
        inspect_direction(&path, &bsdf, &next);
        path.throughput = mul(path.throughput, next.weight);
        path.ray = surface_leave(&surface, next.direction);
        interior_cross(&path.interior, &crossing, next.direction, bsdf.side);
        vmask goes_on = may_scatter & (bsdf.specular | straight) & (largest(path.throughput) > 0.0f);
        goes_on = goes_on & interior_goes_on(&path.interior, &crossing, path.sample.sampler, &path.throughput);
        inspect_carries(&path, goes_on);
        const vuint event = path.depth;
        path.depth = straight ? event : event + 1u;
        if (roulette_matters(ROULETTE_NONE, path.depth)) {
            const vfloat survival = straight ? splat(1.0f) : roulette_late(path.depth);
            sampler_hash_bits(path.sample.sampler, sampler_set(event, SET_ROULETTE), &bits_u, &bits_v);
            inspect_roulette(&path, survival, unit_interval(bits_u));
            goes_on = goes_on & (unit_interval(bits_u) < survival);
            path.throughput = scale(path.throughput, inverse_or_one(survival));
        }
        inspect_leaves(&path, goes_on);
        const vmask ended = path.alive & !goes_on;
        inspect_end(scene, pool, &path, ended);
        if (lane_any(ended)) pool_deliver(pool, &path.sample, color_of_film(scene, path.radiance), ended);
        path.alive = path.alive & !ended;
    }
}

#endif
