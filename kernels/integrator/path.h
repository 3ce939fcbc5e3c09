// Path tracing with next-event estimation (Kajiya 1986; Veach 1997 for the weights; PBR 4ed, 13.2–13.4), a path in every lane.
//
// A work-item works through a pool of samples: the samples [first, first + count) of LANES neighbouring pixels. A lane whose path
// ends delivers it and takes the next of the pool at once, so lanes stay full. No path is ever cut: it ends where the material, the
// scene, the roulette or the depth asked for ends it.
#ifndef INTEGRATOR_PATH_H
#define INTEGRATOR_PATH_H

#include "camera/perspective.h"
#include "film/pool.h"
#include "geometry/surface.h"
#include "light/light.h"
#include "material/bsdf.h"

typedef struct {
    vmask alive;
    PoolSample sample;       // which one of the pool, and its random numbers
    Ray ray;                 // the next segment
    vec3 throughput;         // what the camera gets of the radiance arriving along it
    vec3 radiance;           // found so far
    vuint depth;             // scattering events so far
    vfloat material_pdf;     // density of the ray's direction times the number of such rays; 0 from the camera or a delta
    vmask diffused;          // it has met a surface that is not a delta
} Path;

// The first diffuse hit, kept for the further rays that leave it.
typedef struct {
    Ray ray;
    Hit hit;
    vec3 throughput;
    vuint depth;
    vuint left;              // rays that have still to leave
} Branch;

static void path_start(const Scene* scene, vmask start, Path* path) {
    vfloat film_x, film_y;
    pool_film(scene->settings, &path->sample, &film_x, &film_y);
    ray_replace(&path->ray, perspective_ray(scene, film_x, film_y, path->sample.sampler), start);
    path->throughput = choose(start, vec3_all(1.0f), path->throughput);
    path->radiance = choose(start, vec3_all(0.0f), path->radiance);
    path->depth = start ? splat_uint(0u) : path->depth;
    path->material_pdf = start ? splat(0.0f) : path->material_pdf;
    path->diffused = path->diffused & !start;
}

// The weight of a sample found with density `a` when it could have been found with density `b` too (balance heuristic).
static vfloat path_weight(vfloat a, vfloat b) {
    const vfloat sum = a + b;
    return sum > 0.0f ? a / (sum > 0.0f ? sum : splat(1.0f)) : splat(0.0f);
}

// Light that the ray ran into: from a surface that shines, or from outside the scene.
static vec3 path_emission(const Scene* scene, const Path* path, const Surface* surface, vmask hit, uint shadow_rays) {
    vfloat pdf, outside_pdf;
    vec3 emitted = light_environment(scene, &outside_pdf);
    pdf = hit ? splat(0.0f) : outside_pdf;
    emitted = choose(hit, vec3_all(0.0f), emitted);
    const vmask shines = hit & (surface->light != NONE);
    if (lane_any(shines)) {
        vfloat light_pdf;
        emitted = choose(shines, light_emitted(scene, surface, path->ray.origin, &light_pdf), emitted);
        pdf = shines ? light_pdf : pdf;
    }
    const uint strategy = scene->settings->strategy;
    const vmask only_here = path->material_pdf == 0.0f;
    vfloat weight = path_weight(path->material_pdf, pdf * (float)shadow_rays);
    if (strategy == STRATEGY_LIGHTS) weight = splat(0.0f);
    if (strategy == STRATEGY_MATERIALS) weight = splat(1.0f);
    weight = only_here ? splat(1.0f) : weight;
    return scale(mul(path->throughput, emitted), weight);
}

// One light, sampled: its part of the radiance leaving the surface, before anything in the way is considered.
static vec3 path_direct(const Scene* scene, const Bsdf* bsdf, const LightSample* light, uint shadow_rays, uint material_rays) {
    vfloat material_pdf;
    const vec3 f = bsdf_eval(bsdf, light->direction, &material_pdf);
    const vmask usable = light->pdf > 0.0f;
    const uint strategy = scene->settings->strategy;
    vfloat weight = path_weight(light->pdf * (float)shadow_rays, material_pdf * (float)material_rays);
    if (strategy == STRATEGY_LIGHTS || material_rays == 0) weight = splat(1.0f);
    if (strategy == STRATEGY_MATERIALS && material_rays != 0) weight = splat(0.0f);
    weight = light->delta ? splat(1.0f) : weight;
    const vfloat share = weight / ((usable ? light->pdf : splat(1.0f)) * (float)shadow_rays);
    return choose(usable, scale(mul(f, light->radiance), share), vec3_all(0.0f));
}

// Whether the path goes on after this vertex, and its throughput divided by the probability that it does.
static vmask path_roulette(const Scene* scene, Path* path, const Surface* surface, vuint bits) {
    const uint roulette = scene->settings->roulette;
    vfloat survival = splat(1.0f);
    if (roulette == ROULETTE_ABSORPTION) survival = splat(1.0f) - surface->absorption;
    if (roulette == ROULETTE_THROUGHPUT)
        survival = path->depth >= 4u ? lesser(largest(path->throughput), splat(0.95f)) : splat(1.0f);
    const vmask goes_on = unit_interval(bits) < survival;
    path->throughput = scale(path->throughput, splat(1.0f) / (survival > 0.0f ? survival : splat(1.0f)));
    return goes_on;
}

static void path_trace(const Scene* scene, Pool* pool, PoolStats* stats) {
    __global const Settings* settings = scene->settings;
    const uint shadow_rays = settings->shadow_rays, indirect_rays = settings->indirect_rays, max_depth = settings->max_depth;
    Path path;
    Branch branch;
    path.alive = splat_uint(0u) != splat_uint(0u);
    path.diffused = path.alive;
    path.depth = splat_uint(0u);
    path.material_pdf = splat(0.0f);
    path.throughput = path.radiance = vec3_all(0.0f);
    path.ray.origin = vec3_all(0.0f);
    path.ray.direction = vec3_of(splat(0.0f), splat(0.0f), splat(1.0f));
    path.ray.limit = splat(FAR);
    path.ray.from = path.ray.to = splat_uint(NONE);
    branch.ray = path.ray;
    branch.hit.distance = splat(0.0f);
    branch.hit.primitive = splat_uint(0u);
    branch.throughput = vec3_all(0.0f);
    branch.depth = branch.left = splat_uint(0u);
    vmask resumes = path.alive;

    for (;;) {
        // Lanes without a path take the next sample of the pool
        const vmask idle = !path.alive;
        if (lane_any(idle)) {
            const vmask started = pool_take(settings, pool, idle, &path.sample);
            if (lane_any(started)) path_start(scene, started, &path);
            path.alive = path.alive | started;
            if (!lane_any(path.alive)) {
                if (pool_empty(pool)) break;
                continue;
            }
        }

        // Find the nearest surface along each ray; a path that resumes at its branch knows it already
        const vmask traced = path.alive & !resumes;
        Hit hit = traverse_nearest(&scene->bvh, &path.ray, traced);
        stats->rays += lane_count(traced);
        hit.distance = resumes ? branch.hit.distance : hit.distance;
        hit.primitive = resumes ? branch.hit.primitive : hit.primitive;
        const vmask found = path.alive & (hit.primitive != NONE);
        const Surface surface = surface_at(scene, &path.ray, hit, found);

        // Add the light the ray ran into
        const vec3 emission = path_emission(scene, &path, &surface, found, shadow_rays);
        path.radiance = choose(traced, add(path.radiance, emission), path.radiance);
        stats->deepest = pool_deepest(stats->deepest, path.depth, traced);

        // Add light from sampled points of the lights, as far as nothing is in the way
        const vmask may_scatter = found & (path.depth < max_depth);
        const Bsdf bsdf = bsdf_at(&surface, path.ray.direction);
        const vmask diffuse = may_scatter & bsdf.smooth;
        const vmask first_diffuse = diffuse & !path.diffused;
        const vmask lit = diffuse & !resumes;
        vuint bits_u, bits_v;
        if (settings->light_count > 0 && lane_any(lit)) {
            for (uint m = 0; m < shadow_rays; ++m) {
                Sampler sampler = path.sample.sampler;
                sampler.index = sampler.index * shadow_rays + m;
                sampler_bounce_bits(sampler, SET_LIGHT, path.depth, &bits_u, &bits_v);
                const LightSample light = light_sample(scene, surface.point, bits_u, bits_v);
                const vec3 later = path_direct(scene, &bsdf, &light, shadow_rays, 1u);
                const vec3 first = indirect_rays == 1 ? later : path_direct(scene, &bsdf, &light, shadow_rays, indirect_rays);
                const vec3 direct = choose(first_diffuse, first, later);
                const vmask asked = lit & (largest(direct) > 0.0f);
                const Ray shadow_ray = light_shadow_ray(&surface, &light);
                const vmask blocked = traverse_occluded(&scene->bvh, &shadow_ray, asked);
                stats->shadow_rays += lane_count(asked);
                const vec3 arriving = mul(path.throughput, direct);
                path.radiance = choose(asked & !blocked, add(path.radiance, arriving), path.radiance);
                stats->deepest = pool_deepest(stats->deepest, path.depth + 1u, asked);
            }
        }

        // Remember the first diffuse hit when several rays leave it
        vfloat ray_count = splat(1.0f);
        if (indirect_rays > 1 && lane_any(first_diffuse)) {
            const vmask opens = first_diffuse & !resumes;
            ray_replace(&branch.ray, path.ray, opens);
            branch.hit.distance = opens ? hit.distance : branch.hit.distance;
            branch.hit.primitive = opens ? hit.primitive : branch.hit.primitive;
            branch.throughput =
                choose(opens, scale(path.throughput, splat(1.0f) / (float)indirect_rays), branch.throughput);
            branch.depth = opens ? path.depth : branch.depth;
            branch.left = opens ? splat_uint(indirect_rays - 1u) : branch.left;
            path.throughput = choose(opens, branch.throughput, path.throughput);
            path.sample.sampler.index = opens ? path.sample.sampler.index * indirect_rays : path.sample.sampler.index;
            ray_count = first_diffuse ? splat((float)indirect_rays) : ray_count;
        }
        path.diffused = path.diffused | diffuse;

        // Choose where the light came from, and let the roulette decide whether to look there
        sampler_bounce_bits(path.sample.sampler, SET_MATERIAL, path.depth, &bits_u, &bits_v);
        const BsdfSample next = bsdf_sample(&bsdf, bits_u, bits_v);
        path.throughput = mul(path.throughput, next.weight);
        path.depth = path.depth + 1u;
        vmask goes_on = may_scatter & (largest(path.throughput) > 0.0f);
        if (indirect_rays == 0) goes_on = goes_on & !diffuse;
        if (settings->roulette != ROULETTE_NONE) {
            sampler_hash_bits(path.sample.sampler, path.depth * SETS_PER_BOUNCE + SET_ROULETTE, &bits_u, &bits_v);
            goes_on = goes_on & path_roulette(scene, &path, &surface, bits_u);
        }
        path.ray = surface_leave(&surface, next.direction);
        path.material_pdf = next.pdf * ray_count;

        // A path that ended resumes at its branch while rays are left there, else it is delivered
        const vmask ended = path.alive & !goes_on;
        resumes = ended & (branch.left > 0u);
        if (indirect_rays > 1 && lane_any(resumes)) {
            branch.left = resumes ? branch.left - 1u : branch.left;
            ray_replace(&path.ray, branch.ray, resumes);
            path.throughput = choose(resumes, branch.throughput, path.throughput);
            path.depth = resumes ? branch.depth : path.depth;
            path.sample.sampler.index = resumes ? path.sample.sampler.index + 1u : path.sample.sampler.index;
            path.diffused = path.diffused & !resumes;
        }
        const vmask done = ended & !resumes;
        if (lane_any(done)) pool_deliver(pool, &path.sample, path.radiance, done);
        path.alive = path.alive & !done;
    }
}

#endif
