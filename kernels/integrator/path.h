// Path tracing with next-event estimation (Kajiya 1986; Veach 1997 for the weights; PBR 4ed, 13.2–13.4), a path in every lane.
//
// A work-item works through a pool of samples: the samples [first, first + count) of some neighbouring pixels. A lane whose path
// ends delivers it and takes the next of the pool at once, so lanes stay full. No path is ever cut: it ends where the material, the
// scene, the roulette or the depth asked for ends it. Where rays part on their way through the tree, a work-item carries several
// packets of paths, `path[0]` to `path[PACKETS - 1]`, so that enough rays take turns (geometry/traverse.h); else it carries one.
#ifndef INTEGRATOR_PATH_H
#define INTEGRATOR_PATH_H

#include "geometry/surface.h"
#include "integrator/path_state.h"
#include "light/light.h"
#include "material/bsdf.h"

// Where the paths of a packet have arrived.
typedef struct {
    Hit hit;
    Surface surface;
    Bsdf bsdf;
    vmask may_scatter;       // there is a surface, and the path may go on from it
    vmask diffuse;           // so that light sampling makes sense
    vmask lit;               // so that light has still to be sampled
} Vertex;

// The first diffuse hit, kept for the further rays that leave it.
typedef struct {
    Ray ray;
    Hit hit;
    vec3 throughput;
    vuint depth;
    vuint left;              // rays that have still to leave
    vmask resumes;           // the path is back there, where its next one leaves
} Branch;

static Branch path_no_branch(const Path* path) {
    Branch branch;
    branch.ray = path->ray;
    branch.hit.distance = splat(0.0f);
    branch.hit.primitive = splat_uint(0u);
    branch.throughput = vec3_all(0.0f);
    branch.depth = branch.left = splat_uint(0u);
    branch.resumes = path->alive;
    return branch;
}

// The weight of a sample found with density `a` when it could have been found with density `b` too (balance heuristic).
static vfloat path_weight(vfloat a, vfloat b) {
    return a * inverse_or_one(a + b);
}

// Light that the ray ran into: from a surface that shines, or from outside the scene.
static vec3 path_emission(const Scene* scene, const Path* path, const Surface* surface, vmask hit) {
    vfloat pdf, outside_pdf;
    vec3 emitted = light_environment(scene, path->ray.origin, path->normal, &outside_pdf);
    pdf = hit ? splat(0.0f) : outside_pdf;
    emitted = choose(hit, vec3_all(0.0f), emitted);
    const vmask shines = hit & (surface->light != NONE);
    if (lane_any(shines)) {
        vfloat light_pdf;
        emitted = choose(shines, light_emitted(scene, surface, path->ray.origin, path->normal, &light_pdf), emitted);
        pdf = shines ? light_pdf : pdf;
    }
    const uint strategy = scene->settings->strategy;
    const vmask only_here = path->material_pdf == 0.0f;
    vfloat weight = path_weight(path->material_pdf, pdf * (float)scene->settings->shadow_rays);
    if (strategy == STRATEGY_LIGHTS) weight = splat(0.0f);
    if (strategy == STRATEGY_MATERIALS) weight = splat(1.0f);
    weight = only_here ? splat(1.0f) : weight;
    return scale(mul(path->throughput, emitted), weight);
}

// The surface that each ray met, with the light that the ray ran into added. `traced` leaves out paths that were there before.
static Vertex path_arrive(const Scene* scene, Path* path, Hit hit, vmask traced, PoolStats* stats) {
    Vertex v;
    const vmask found = path->alive & (hit.primitive != NONE);
    v.hit = hit;
    v.surface = surface_at(scene, &path->ray, hit, found);
    stats->rays += lane_count(traced);
    stats->deepest = pool_deepest(stats->deepest, path->depth, traced);
    path->radiance = choose(traced, add(path->radiance, path_emission(scene, path, &v.surface, found)), path->radiance);
    v.bsdf = bsdf_at(&v.surface, path->ray.direction);
    v.may_scatter = found & (path->depth < scene->settings->max_depth);
    v.diffuse = v.may_scatter & v.bsdf.smooth;
    v.lit = v.diffuse & traced;
    return v;
}

// One light, sampled: its part of the radiance leaving the surface, before anything in the way is considered. With the balance
// heuristic, weight / density is one over the sum of all densities that could have found the point.
static vec3 path_direct(const Scene* scene, const Bsdf* bsdf, const LightSample* light, uint shadow_rays, uint material_rays) {
    vfloat material_pdf;
    const vec3 f = bsdf_eval(bsdf, light->direction, &material_pdf);
    const uint strategy = scene->settings->strategy;
    const vmask only_here = strategy == STRATEGY_LIGHTS ? light->pdf > 0.0f : light->delta;
    const vmask usable = strategy == STRATEGY_MATERIALS && material_rays != 0 ? light->delta : light->pdf > 0.0f;
    const vfloat other = only_here ? splat(0.0f) : material_pdf * (float)material_rays;
    const vfloat density = light->pdf * (float)shadow_rays + other;
    return choose(usable, scale(mul(f, light->radiance), inverse_or_one(density)), vec3_all(0.0f));
}

// The probability that the roulette lets a path go on, of this depth and throughput after the vertex.
static vfloat path_survival(const Scene* scene, vec3 throughput, vuint depth, const Surface* surface) {
    const uint roulette = scene->settings->roulette;
    if (roulette == ROULETTE_ABSORPTION) return splat(1.0f) - surface->absorption;
    if (roulette == ROULETTE_THROUGHPUT) return depth >= 4u ? lesser(largest(throughput), splat(0.95f)) : splat(1.0f);
    return splat(1.0f);
}

// Whether the path goes on after this vertex, and its throughput divided by the probability that it does.
static vmask path_roulette(const Scene* scene, Path* path, const Surface* surface, vuint bits) {
    const vfloat survival = path_survival(scene, path->throughput, path->depth, surface);
    const vmask goes_on = unit_interval(bits) < survival;
    path->throughput = scale(path->throughput, inverse_or_one(survival));
    return goes_on;
}

// The lights to be sampled for the packets' points, of each pixel's shadow ray number `m`.
static void path_choose_lights(const Scene* scene, const Path* path, const Vertex* vertex, uint m, LightChoice* choice) {
    TreeWalk walk[PACKETS];
    EACH_PACKET(k) {
        vuint bits_u;
        Sampler sampler = path[k].sample.sampler;
        sampler.index = sampler.index * scene->settings->shadow_rays + m;
        sampler_bounce_bits(sampler, SET_LIGHT, path[k].depth, &bits_u, &choice[k].bits_v);
        walk[k] = tree_begin(vertex[k].surface.point, vertex[k].bsdf.side, bits_u);
    }
    // Level by level for all packets: while one waits for its nodes, others go on
    for (uint level = 0; level < scene->settings->light_levels; ++level) EACH_PACKET(k) tree_step(scene, &walk[k]);
    EACH_PACKET(k) light_choose(scene, &walk[k], &choice[k]);
}

// A point of the light: the ray that has to be free for its light to arrive, and what the camera gets of it then.
static Ray path_aim(const Scene* scene, const Path* path, const Vertex* vertex, const LightChoice* choice, vec3* arriving) {
    const uint shadow_rays = scene->settings->shadow_rays, indirect_rays = scene->settings->indirect_rays;
    const Surface* surface = &vertex->surface;
    const LightSample light = light_sample_chosen(scene, surface->point, surface->primitive, choice);
    vec3 direct = path_direct(scene, &vertex->bsdf, &light, shadow_rays, 1u);
    if (indirect_rays != 1)
        direct = choose(path->diffused, direct, path_direct(scene, &vertex->bsdf, &light, shadow_rays, indirect_rays));
    *arriving = mul(path->throughput, direct);
    return light_shadow_ray(surface, &light);
}

// Light from sampled points of the lights, as far as nothing is in the way; of all packets. `path` and `vertex` are arrays, even where there is
// one packet: rusticl's compiler (Mesa 22.3) crashes over an index into what is none.
static void path_add_direct(const Scene* scene, Path* path, const Vertex* vertex, PoolStats* stats) {
    int any_lit = 0;
    EACH_PACKET(k) any_lit |= lane_any(vertex[k].lit);
    if (scene->settings->light_count == 0 || !any_lit) return;
    Traversal shadows;
    LightChoice choice[PACKETS];
    vec3 arriving[PACKETS];
    vmask asked[PACKETS];
    for (uint m = 0; m < scene->settings->shadow_rays; ++m) {
        path_choose_lights(scene, path, vertex, m, choice);
        EACH_PACKET(k) {
            const Ray shadow_ray = path_aim(scene, &path[k], &vertex[k], &choice[k], &arriving[k]);
            asked[k] = vertex[k].lit & (largest(arriving[k]) > 0.0f);
            traverse_start(&scene->bvh, &shadows, k, &shadow_ray, asked[k], 1);
            stats->shadow_rays += lane_count(asked[k]);
            stats->deepest = pool_deepest(stats->deepest, path[k].depth + 1u, asked[k]);
        }
        traverse_finish(&scene->bvh, &shadows, 1);
        EACH_PACKET(k) {
            const vmask arrives = asked[k] & !traverse_blocked(&shadows, k);
            path[k].radiance = choose(arrives, add(path[k].radiance, arriving[k]), path[k].radiance);
        }
    }
}

// Choose where the light came from, and let the roulette decide whether to look there. Returns where the path goes on.
static vmask path_scatter(const Scene* scene, Path* path, const Vertex* vertex) {
    const Bsdf* bsdf = &vertex->bsdf;
    vuint bits_u, bits_v;
    sampler_bounce_bits(path->sample.sampler, SET_MATERIAL, path->depth, &bits_u, &bits_v);
    const BsdfSample next = bsdf_sample(bsdf, bits_u, bits_v);
    path->throughput = mul(path->throughput, next.weight);
    path->depth = path->depth + 1u;
    path->normal = bsdf->side;
    path->material_pdf = next.pdf;
    path->ray = surface_leave(&vertex->surface, next.direction);
    vmask goes_on = vertex->may_scatter & (largest(path->throughput) > 0.0f);
    if (scene->settings->indirect_rays == 0) goes_on = goes_on & !bsdf->smooth;
    if (scene->settings->roulette != ROULETTE_NONE) {
        sampler_hash_bits(path->sample.sampler, path->depth * SETS_PER_BOUNCE + SET_ROULETTE, &bits_u, &bits_v);
        goes_on = goes_on & path_roulette(scene, path, &vertex->surface, bits_u);
    }
    return goes_on;
}

// Several rays leave the first diffuse hit: remember it. Each of them carries its share of the throughput and has its own place in
// the sequence of random numbers.
static void path_branch(Path* path, Branch* branch, Hit hit, vmask opens, uint rays) {
    if (!lane_any(opens)) return;
    const vec3 share = scale(path->throughput, splat(1.0f) / (float)rays);
    ray_replace(&branch->ray, path->ray, opens);
    branch->hit.distance = opens ? hit.distance : branch->hit.distance;
    branch->hit.primitive = opens ? hit.primitive : branch->hit.primitive;
    branch->throughput = choose(opens, share, branch->throughput);
    branch->depth = opens ? path->depth : branch->depth;
    branch->left = opens ? splat_uint(rays - 1u) : branch->left;
    path->throughput = choose(opens, share, path->throughput);
    path->sample.sampler.index = opens ? path->sample.sampler.index * rays : path->sample.sampler.index;
}

// Go back to the branch for the next of its rays.
static void path_resume(Path* path, Branch* branch, vmask resumes) {
    branch->left = resumes ? branch->left - 1u : branch->left;
    ray_replace(&path->ray, branch->ray, resumes);
    path->throughput = choose(resumes, branch->throughput, path->throughput);
    path->depth = resumes ? branch->depth : path->depth;
    path->sample.sampler.index = resumes ? path->sample.sampler.index + 1u : path->sample.sampler.index;
    path->diffused = path->diffused & !resumes;
}

// The nearest surface along each ray; a path that is back at its branch knows it already.
static void path_find(const Scene* scene, const Path* path, const Branch* branch, Hit* hit) {
    Traversal ahead;
    EACH_PACKET(k) traverse_start(&scene->bvh, &ahead, k, &path[k].ray, path[k].alive & !branch[k].resumes, 0);
    traverse_finish(&scene->bvh, &ahead, 0);
    EACH_PACKET(k) {
        hit[k] = traverse_hit(&ahead, k);
        hit[k].distance = branch[k].resumes ? branch[k].hit.distance : hit[k].distance;
        hit[k].primitive = branch[k].resumes ? branch[k].hit.primitive : hit[k].primitive;
        surface_prefetch(scene, hit[k]);
    }
}

// Go on in a sampled direction; the first diffuse hit may send out several rays. A path that ends goes back to its branch while rays
// are left there, else it is delivered.
static void path_go_on(const Scene* scene, const Pool* pool, Path* path, Branch* branch, const Vertex* vertex) {
    const uint indirect_rays = scene->settings->indirect_rays;
    const vmask first_diffuse = vertex->diffuse & !path->diffused;
    if (indirect_rays > 1) path_branch(path, branch, vertex->hit, first_diffuse & !branch->resumes, indirect_rays);
    path->diffused = path->diffused | vertex->diffuse;
    const vmask goes_on = path_scatter(scene, path, vertex);
    if (indirect_rays > 1) path->material_pdf = path->material_pdf * (first_diffuse ? splat((float)indirect_rays) : splat(1.0f));

    const vmask ended = path->alive & !goes_on;
    branch->resumes = ended & (branch->left > 0u);
    if (indirect_rays > 1 && lane_any(branch->resumes)) path_resume(path, branch, branch->resumes);
    const vmask done = ended & !branch->resumes;
    if (lane_any(done)) pool_deliver(pool, &path->sample, path->radiance, done);
    path->alive = path->alive & !done;
}

// Returns whether any lane of any packet has a path.
static int path_next_of_all(const Scene* scene, Pool* pool, CameraRays* waiting, Path* path) {
    int any = 0;
    EACH_PACKET(k) any |= path_next(scene, pool, waiting, &path[k]);
    return any;
}

static void path_trace(const Scene* scene, Pool* pool, PoolStats* stats) {
    CameraRays waiting = camera_rays_none();
    Path path[PACKETS];
    Branch branch[PACKETS];
    Hit hit[PACKETS];
    Vertex vertex[PACKETS];
    EACH_PACKET(k) {
        path[k] = path_none();
        branch[k] = path_no_branch(&path[k]);
    }

    while (path_next_of_all(scene, pool, &waiting, path)) {
        // Find the nearest surface along each ray, and add the light the ray ran into
        path_find(scene, path, branch, hit);
        EACH_PACKET(k) vertex[k] = path_arrive(scene, &path[k], hit[k], path[k].alive & !branch[k].resumes, stats);

        // Add light that comes straight from the lights
        path_add_direct(scene, path, vertex, stats);

        // Choose where the light came from, and go on there
        EACH_PACKET(k) path_go_on(scene, pool, &path[k], &branch[k], &vertex[k]);
    }
}

#endif
