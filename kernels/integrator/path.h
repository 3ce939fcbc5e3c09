// Path tracing with next-event estimation (Kajiya 1986; Veach 1997 for the weights; PBR 4ed, 13.2–13.4), a path in every lane.
//
// A work-item works through a pool of samples: the samples [first, first + count) of some neighbouring pixels. A lane whose path
// ends delivers it and takes the next of the pool at once, so lanes stay full. No path is ever cut: it ends where the material, the
// scene, the roulette or the depth asked for ends it. Where rays part on their way through the tree, a work-item carries several
// packets of paths, `path[0]` to `path[PACKETS - 1]`, so that enough rays take turns (geometry/traverse.h); else it carries one.
//
// What happens at a vertex:
//
//     vertex                 light samples   emission met next       roulette, depth     radiance
//     diffuse, glossy        yes             by MIS                  by flux, + 1        by the BSDF
//     delta                  no              in full                 by flux, + 1        1/eta² where it crosses
//     passes, keeps nothing  no: dark (1)    in full, or by MIS      by flux, + 1        1/eta²
//     passes, keeps some     yes             by MIS                  by flux, + 1        1/eta² where it crosses
//     in a medium            yes, or dark    by MIS, or in full      by flux, + 1 (2)    by the phase function
//     straight               no              as at the vertex before (3)   none, + 0     the index is the same
//     back (splits)          no: had them    by MIS                  by flux, + 1        as the first time
//
// (1) Where the medium beyond is lit from inside it is diffuse on the other side. (2) Earlier where the medium has no end: medium_survival.
// (3) With STRAIGHT_SHADOWS; elsewhere in full, because no shadow ray passes. eta: material/index.h; by flux: core/roulette.h; MIS weighs by the
// balance heuristic (core/mis.h). "Passes" are the surfaces of subsurface materials (Bsdf.passes).
//
// For a reader: path_trace, at the end, is the loop. Everything before it is one of its steps, for all lanes of a packet.
#ifndef INTEGRATOR_PATH_H
#define INTEGRATOR_PATH_H

#include "core/invariant.h"
#include "core/roulette.h"
#include "geometry/find.h"
#include "geometry/surface.h"
#include "geometry/terminator.h"
#include "guiding/guide.h"
#ifdef PATH_RECORDED
#include "guiding/training.h"
#endif
#include "integrator/inspect.h"
#include "integrator/path_state.h"
#ifdef PATH_BIDIRECTIONAL
#include "integrator/bdpt_weights.h"
#else
#include "integrator/path_weights.h"
#endif
#include "integrator/regroup.h"
#include "integrator/shadow.h"
#include "light/light.h"
#include "material/bsdf.h"
#include "material/interior.h"
#include "medium/homogeneous.h"
#include "medium/walk.h"
#include "spectral/color.h"
#include "specular/chains.h"

// Where the events of paths are recorded, to train the guiding field, or to be looked at.
#if defined(PATH_RECORDED) || defined(PATH_INSPECTED)
#define PATH_RECORDS , __global uint* records
#else
#define PATH_RECORDS
#endif

// The paths whose ray has not been where it goes.
static vmask path_traces(const Path* path) { return path->alive & !split_back(&path->split); }

// Where smooth glass sends each wavelength another way a path goes on with the one that was chosen; rough glass is another BSDF at each of them.
static void path_disperse(const Scene* scene, Path* path, Vertex* v, vmask where) {
#if defined(SPECTRAL) && defined(DISPERSION) && !defined(WAVELENGTHS_EQUAL)
    const vmask parts = where & v->bsdf.disperses & !interior_straight(&v->crossing);
    if (!lane_any(parts)) return;
    vmask alone = parts;
#ifdef BSDF_APART
    const vmask apart = parts & !v->bsdf.specular;
    alone = parts & !apart;
    if (lane_any(apart)) {
        Scene at = *scene;
        for (uint k = 0; k < 3u; ++k) {
            Surface surface = v->surface;
            at.wavelengths.first = splat_uint(k);
            surface.ior = color_index(&at, surface.index, &surface.disperses);
            interior_meet(&at, &path->interior, &surface, where);
            bsdf_at(&at, &surface, path->ray.direction, &v->each[k]);
            v->each[k].closure.scene = scene;  // it outlives `at`, and has the same wavelengths: other lanes' surfaces scatter colors
        }
        v->bsdf.apart = apart;
        v->bsdf.each = v->each;
        const vec3 carried = split_throughput(&path->split, path->throughput);
        v->bsdf.shares = scale(carried, inverse_or_one(carried.x + carried.y + carried.z));
    }
#endif
    path->throughput = color_alone(scene, path->throughput, alone);
    path_put_down(path);
#endif
}

// The surface that each ray met, or the point of a medium where it scatters.
static void path_vertex(const Scene* scene, Path* path, Hit hit, PoolStats* stats, Vertex* v) {
    const vmask arrived = path->alive & (hit.primitive != NONE), on_surface = arrived & !medium_scatters(hit);
    v->surface = surface_at(scene, &path->ray, hit, on_surface);
    terminator_offset(scene, &v->surface, on_surface);
    surface_random(&v->surface, path->sample.sampler, path->depth);
    medium_surface(scene, &path->ray, &path->interior, hit, &v->surface);
    v->crossing = interior_meet(scene, &path->interior, &v->surface, on_surface);
    bsdf_at(scene, &v->surface, path->ray.direction, &v->bsdf);
    v->traced = path_traces(path);
    v->found = arrived & v->traced;
    path_disperse(scene, path, v, on_surface);
    const vmask straight = interior_straight(&v->crossing);
    v->scatters = arrived & ((path->depth < scene->settings->max_depth) | straight);
    v->dark = walk_in_the_dark(scene, &path->interior, &v->crossing, &v->bsdf);
    v->samples_lights = v->scatters & !(v->bsdf.specular | straight | v->dark);
    guide_look_up(scene, path, v);
    stats->rays += lane_count(v->traced);
    stats->deepest = pool_deepest(stats->deepest, path->depth, v->traced);
    INVARIANT(path, INVARIANT_SURFACE, terminator_violates(&v->surface, &path->ray, on_surface));
    INVARIANT(path, INVARIANT_BSDF, bsdf_violates(&v->bsdf, arrived));
#ifdef MATERIALS
    INVARIANT(path, INVARIANT_CLOSURE, closure_violates(&v->bsdf.closure, arrived));
#endif
    inspect_vertex(path, hit, v);
}

// How far each path gets in a medium: it need not look for what is further away.
static void path_free(const Scene* scene, Path* path, FreePath* free) {
#ifdef MEDIA
    *free = medium_free_path(scene, &path->interior, &path->ray, path->sample.sampler, path->depth, path->throughput);
    path->ray.limit = split_back(&path->split) ? path->ray.limit : lesser(path->ray.limit, free->length);
#endif
}

// Find where each ray meets the scene. `path` and `hit` are arrays, even where there is one packet: rusticl's compiler (Mesa 22.3)
// crashes over an index into what is none.
static void path_find(const Scene* scene, Path* path, FreePath* free, Hit* hit) {
    Search ahead;
    EACH_PACKET(k) path_free(scene_of(scene, k), &path[k], &free[k]);
    EACH_PACKET(k) {
        const vmask camera = path[k].depth == 0u;
        find_start(scene, &ahead, k, &path[k].ray, path[k].sample.sampler, path[k].depth, camera, path_traces(&path[k]));
    }
    find_finish(scene, &ahead, hit);
    EACH_PACKET(k) {
        split_again(&path[k].split, &hit[k]);
        surface_prefetch(scene, hit[k]);
    }
}

// Go there through what lies on the way: it absorbs, or scatters the path before it arrives.
static void path_travel(const Scene* scene, Path* path, const FreePath* free, Hit* hit) {
#ifdef PATH_INSPECTED
    vec3 glow = vec3_all(0.0f);
    medium_travel(scene, &path->interior, &path->ray, free, path_traces(path), &path->throughput, hit, &glow);
    inspect_glow(scene, path, glow);
#else
    medium_travel(scene, &path->interior, &path->ray, free, path_traces(path), &path->throughput, hit, &path->radiance);
#endif
}

// Add the radiance of a light that the ray ran into; `density` is that of light samples there, once they chose this light.
static void path_count_emission(const Scene* scene, Path* path, const LightRow* light, const Surface* surface, vec3 emitted, vfloat density, vmask where) {
    const vfloat pdf = density * light_probability(scene, path_last_point(path), path->normal, light);
    const vfloat weight = path_weight_found(scene, path, light, surface, pdf);
    const vec3 counted = scale(mul(path->throughput, emitted), path->counts_in_full ? splat(1.0f) : weight);
    path->radiance = choose(where, add(path->radiance, counted), path->radiance);
    inspect_emission(scene, path, light, surface, emitted, density, pdf, weight, counted, where);
}

// Add the light that the ray ran into: from a surface that shines, or from outside the scene. It counts in full where light sampling at
// the last vertex could not have found it.
static void path_add_emission(const Scene* scene, Path* path, const Vertex* vertex) {
    __global const Settings* settings = scene->settings;
    const Surface* surface = &vertex->surface;
    const vmask shines = vertex->found & light_shines(surface);
    const vmask there = (splat_uint(settings->environment) != NONE) & !environment_hidden(scene, path->depth);
    const vmask outside = vertex->traced & !vertex->found & there;
    if (!lane_any(shines | outside)) return;
    const LightRow light = light_met(scene, surface, shines, outside);
    vec3 emitted = vec3_all(0.0f);
    vfloat density = splat(0.0f);
    if (lane_any(shines)) {
        emitted = emission_found(scene, &light, surface, shines);
        density = light_density(&light, surface, path_last_point(path));
    }
    if (lane_any(outside)) {
        const EnvironmentSample around = environment_found(scene, &light, path->ray.direction, outside);
        emitted = choose(outside, around.radiance, emitted);
        density = outside ? around.pdf : density;
    }
    const vfloat share = chains_leave_surface(scene, path, &light, surface, shines);
    path_count_emission(scene, path, &light, surface, scale(emitted, share), density, shines | outside);
}

// The same for the sun, which is a light of its own before the sky.
static void path_add_sun(const Scene* scene, Path* path, const Vertex* vertex) {
#ifdef SUN
    if (!scene_has(scene, HAS_SUN)) return;
    const EnvironmentSample sun = sun_along(scene, path->ray.direction);
    const vmask seen = vertex->traced & !vertex->found & (sun.pdf > 0.0f) & !environment_hidden(scene, path->depth);
    if (!lane_any(seen)) return;
    const LightRow light = light_at(scene, splat_uint(sun_light(scene)), splat(0.0f));
    const vfloat share = chains_leave(scene, path, splat_uint(sun_light(scene)), sun.pdf, splat(1.0f), splat(1.0f), mask_all(), seen);
    path_count_emission(scene, path, &light, &vertex->surface, scale(sun.radiance, share), sun.pdf, seen);
#endif
}

// Choose a light for each packet's points, where one is asked for: each pixel's shadow ray number `m`.
static void path_choose_lights(const Scene* scene, const Path* path, const Vertex* vertex, const vmask* asked, uint m, LightChoice* choice) {
    TreeWalk walk[PACKETS];
    Sampler sampler[PACKETS];
    EACH_PACKET(k) {
        const vuint set = sampler_set(path[k].depth, SET_LIGHT);
        sampler[k] = sampler_split(path[k].sample.sampler, scene->settings->shadow_rays, splat_uint(m));
        walk[k] = light_begin(scene, vertex[k].surface.point, bsdf_receives(&vertex[k].bsdf), sampler[k], set, &choice[k]);
    }
    // Step by step for all packets: while one waits for memory, others go on
    for (uint level = 0; level < scene->settings->light_levels; ++level) EACH_PACKET(k) tree_step(scene, &walk[k]);
    EACH_PACKET(k) light_choose(scene, &walk[k], sampler[k], sampler_set(path[k].depth, SET_LIGHT), asked[k], &choice[k]);
    EACH_PACKET(k) if (lane_any(asked[k])) environment_guide(scene, &choice[k].around);
}

// The media that a ray to a light begins in.
static Interior path_towards(const Path* path, const Vertex* vertex, const LightSample* light) {
    return interior_towards(&path->interior, &vertex->crossing, light->direction, vertex->bsdf.side);
}

// The share of the path's radiance that one of its light samples brings, as far as nothing is in the way.
static vec3 path_direct(const Scene* scene, Path* path, const Vertex* vertex, const LightSample* light, const Interior* in) {
    __global const Settings* settings = scene->settings;
    vfloat bsdf_pdf;
    const vec3 f_cosine = bsdf_eval(&vertex->bsdf, light->direction, &bsdf_pdf);
    path_take_again(path, as_uint(bsdf_pdf));
    bsdf_pdf = guide_pdf(scene, vertex, light->direction, bsdf_pdf);
    const vfloat weight = path_weight_sampled(scene, path, vertex, light, bsdf_pdf);
    const vfloat share = weight * guide_light_weight(vertex) * inverse_or_one(light->pdf * (float)settings->shadow_rays);
    const vec3 left = shadow_straight(scene, in, light, vertex->surface.point);
    const vec3 arriving = mul(mul(mul(path->throughput, f_cosine), light->radiance), left);
    inspect_light_sample(scene, path, &vertex->surface, light, bsdf_pdf, path_bsdf_samples(scene, path, vertex), weight, scale(arriving, share));
    return choose(light->pdf > 0.0f, scale(arriving, share), vec3_all(0.0f));
}

// Light samples of each packet on their way to its points.
typedef struct {
    ShadowRay shadow[PACKETS];
    vec3 arriving[PACKETS];  // as far as nothing is in the way; 0 where no shadow ray is needed
} Direct;

static vmask path_asks(const Direct* direct, uint packet) { return largest(direct->arriving[packet]) > 0.0f; }

// For all packets choose a light, and a point of it: each pixel's light sample number `m`.
static void path_sample_light(const Scene* scene, Path* path, const Vertex* vertex, uint m, Direct* direct, PoolStats* stats) {
    LightChoice choice[PACKETS];
    vmask asked[PACKETS];
    EACH_PACKET(k) asked[k] = vertex[k].samples_lights & vertex[k].traced & guide_takes_light(&path[k], &vertex[k]);
    path_choose_lights(scene, path, vertex, asked, m, choice);
    EACH_PACKET(k) {
        const Surface* surface = &vertex[k].surface;
        direct->arriving[k] = vec3_all(0.0f);
        if (lane_any(asked[k])) {
            const LightSample light = light_sample_chosen(scene_of(scene, k), surface->point, surface->primitive, &choice[k], surface_time(surface));
            inspect_choice(scene_of(scene, k), &path[k], &choice[k]);
            INVARIANT(&path[k], INVARIANT_LIGHT_SAMPLE, light_sample_violates(&light, asked[k]));
            const Interior in = path_towards(&path[k], &vertex[k], &light);
            direct->shadow[k] = shadow_ray(surface, &light, &in);
            path_put_shadow(&path[k], &direct->shadow[k]);
            direct->arriving[k] = choose(asked[k], path_direct(scene_of(scene, k), &path[k], &vertex[k], &light, &in), vec3_all(0.0f));
        }
        asked[k] = path_asks(direct, k);
        stats->shadow_rays += lane_count(asked[k]);
        stats->deepest = pool_deepest(stats->deepest, path[k].depth + 1u, asked[k]);
    }
}

// Trace the shadow rays to the lights, and add what arrives.
static void path_add_light(const Scene* scene, Path* path, Direct* direct) {
    Shadows shadows;
    EACH_PACKET(k) shadow_start(scene_of(scene, k), &shadows, k, &direct->shadow[k], path_asks(direct, k));
    shadow_finish(scene, &shadows);
    EACH_PACKET(k) {
        const vmask asked = path_asks(direct, k), arrives = asked & shadow_arrives(&shadows, k, &direct->arriving[k]);
        path[k].radiance = choose(arrives, add(path[k].radiance, direct->arriving[k]), path[k].radiance);
        inspect_arrival(scene_of(scene, k), &path[k], arrives, direct->arriving[k]);
    }
}

// Whether any packet samples lights.
static int path_is_lit(const Scene* scene, const Vertex* vertex) {
    int any = 0;
    EACH_PACKET(k) any |= lane_any(vertex[k].samples_lights & vertex[k].traced);
    return any && scene->settings->light_count > 0;
}

// Direct light, in two halves: while the second one traces shadow rays, nothing of the vertex has to be kept, which may lie in registers. So paths
// scatter in between. With several light samples for each vertex the first half does all of it.
static void path_sample_direct(const Scene* scene, Path* path, const Vertex* vertex, Direct* direct, PoolStats* stats) {
    EACH_PACKET(k) {
        direct->arriving[k] = vec3_all(0.0f);
        direct->shadow[k] = shadow_none();
    }
    if (!path_is_lit(scene, vertex)) return;
#ifdef SEVERAL_SHADOW_RAYS
    for (uint m = 0; m < scene->settings->shadow_rays; ++m) {
        path_sample_light(scene, path, vertex, m, direct, stats);
        path_add_light(scene, path, direct);
    }
#else
    path_sample_light(scene, path, vertex, 0u, direct, stats);
#endif
}
static void path_add_direct(const Scene* scene, Path* path, Direct* direct) {
#ifndef SEVERAL_SHADOW_RAYS
    int any = 0;
    EACH_PACKET(k) any |= lane_any(path_asks(direct, k));
    if (any) path_add_light(scene, path, direct);
#endif
}

// Emission that is met next counts in full where light sampling could not have found it from here: after a delta. And keep the vertex for the other
// rays that part from it.
static void path_leave(const Scene* scene, Path* path, const Vertex* vertex, Hit hit) {
    const vmask straight = interior_straight(&vertex->crossing), shadows_pass = shadow_passes(scene, straight);
    path_note_vertex(scene, path, vertex, !shadows_pass);
    split_leave(&path->split, &path->ray, hit, path->interior, &path->throughput, &path->index_squared, &path->sample.sampler, path->depth,
                vertex->samples_lights, scene->settings->indirect_rays);
}

// Sample the BSDF for the direction to go on in, and for the weight of radiance that arrives along it: β ← β f |cosθ| / p. Returns the paths
// that carry any.
static vmask path_sample_bsdf(const Scene* scene, Path* path, Vertex* vertex) {
    const Bsdf* bsdf = &vertex->bsdf;
    const vmask straight = interior_straight(&vertex->crossing), shadows_pass = shadow_passes(scene, straight);
    vuint bits_u, bits_v;
    sampler_bits(path->sample.sampler, sampler_set(path->depth, SET_BSDF), &bits_u, &bits_v);
    guide_choose(vertex, &bits_u);
    path_put_down(path);
    BsdfSample next = bsdf_sample(bsdf, bits_u, bits_v);
    path_take_again(path, as_uint(next.pdf));
    INVARIANT(path, INVARIANT_BSDF_SAMPLE, bsdf_sample_violates(&next, bsdf->specular, vertex->scatters));
    guide_sample(scene, vertex, bits_u, bits_v, &next);
    interior_straighten(&vertex->crossing, path->ray.direction, &next.direction, &next.weight);
    chains_note(scene, path, vertex, &next);
    inspect_direction(path, bsdf, &next);
    inspect_guided(path, vertex);
    path->throughput = mul(path->throughput, next.weight);
    path->index_squared = straight ? path->index_squared : path->index_squared * bsdf_index_squared(bsdf, next.direction);
    path_note_direction(scene, path, vertex, &next, !shadows_pass);
    path->normal = choose(shadows_pass, path->normal, bsdf_receives(bsdf));
    path_pass(path, vertex->surface.point, shadows_pass);
    path->ray = surface_leave(&vertex->surface, next.direction);
    interior_cross(&path->interior, &vertex->crossing, next.direction, bsdf->side);
    vmask goes_on = vertex->scatters & (largest(path->throughput) > 0.0f);
#if defined(PATH_GATHERS) && (defined(MATERIALS) || defined(MEDIA))
    goes_on = goes_on & (path->counts_in_full | !path_gathers(vertex));
#else
    if (scene->settings->indirect_rays == 0) goes_on = goes_on & path->counts_in_full;
#endif
    return goes_on & interior_goes_on(&path->interior, &vertex->crossing, path->sample.sampler, &path->throughput);
}

// Play Russian roulette with what the path carries, but not where nothing happened to it.
static void path_roulette(const Scene* scene, Path* path, const Vertex* vertex, Hit hit, vmask* goes_on) {
    const vmask straight = interior_straight(&vertex->crossing);
    const vuint event = path->depth;
    path->depth = straight ? event : event + 1u;
    if (!roulette_matters(scene->settings->roulette, path->depth)) return;
    const vfloat played = guide_survival(scene, path, vertex);
    const vfloat open = medium_survival(scene, &path->interior, medium_scatters(hit), path->depth);
    const vfloat survival = straight ? splat(1.0f) : played * open;
    vuint bits, unused;
    sampler_hash_bits(path->sample.sampler, sampler_set(event, SET_ROULETTE), &bits, &unused);
    inspect_roulette(path, survival, unit_interval(bits));
    *goes_on = *goes_on & (unit_interval(bits) < survival);
    path->throughput = scale(path->throughput, inverse_or_one(survival));
}

// Scatter each path at its vertex; `ended` are the paths that do not go on.
static void path_scatter(const Scene* scene, Path* path, Vertex* vertex, Hit hit) {
    path_leave(scene, path, vertex, hit);
    vmask goes_on = path_sample_bsdf(scene, path, vertex);
    inspect_carries(path, goes_on);
    path_roulette(scene, path, vertex, hit, &goes_on);
    inspect_leaves(path, goes_on);
    path->ended = path->alive & !goes_on;
    INVARIANT(path, INVARIANT_RAY, ray_violates(&path->ray, path->alive & !path->ended));
}

// Of these, choose the one at which indices of refraction are read: by what the path carries, on its way and then where it has arrived.
static void path_choose_wavelength(Scene* scene, const Path* path) {
    scene_choose_wavelength(scene, path->sample.sampler, path->depth, split_throughput(&path->split, path->throughput));
}

// Read the scene at the wavelengths of the path's sample.
static void path_look(Scene* scene, const Pool* pool, const Path* path) {
    const Sampler first = split_first_sampler(&path->split, path->sample.sampler);
    scene_at_wavelengths(scene, first, pool->first_sample + pool_number_of(&path->sample));
    path_choose_wavelength(scene, path);
}

// Deliver the samples of paths that ended; their lanes are free for others.
static void path_deliver(const Scene* scene, const Pool* pool, Path* path) {
    const vmask done = split_resume(&path->split, &path->ray, &path->interior, &path->depth, path->ended);
    INVARIANT(path, INVARIANT_PATH, path_violates(path, path->alive));
#ifdef INVARIANTS
    path->radiance = choose(done & path->broken, vec3_of(INVARIANT_NAN, INVARIANT_NAN, INVARIANT_NAN), path->radiance);
    path->broken = path->broken & !done;
#endif
    inspect_end(scene, pool, path, done);
    if (lane_any(done)) pool_deliver(pool, &path->sample, color_of_film(scene, path->radiance), done);
    path->alive = path->alive & !done;
}

// Start paths in lanes that have none. Returns whether any lane of any packet has one.
static int path_next_of_all(const Scene* scene, Pool* pool, CameraRays* waiting, Path* path) {
    int any = 0;
    EACH_PACKET(k) any |= path_next(scene, pool, waiting, &path[k]);
    return any;
}

static void path_trace(const Scene* given, Pool* pool, PoolStats* stats PATH_RECORDS) {
    Scene scene[SCENES];
    scenes_of(given, scene);
    CameraRays waiting = camera_rays_none();
    Path path[PACKETS];
    FreePath free[PACKETS];
    Hit hit[PACKETS];
    Vertex vertex[PACKETS];
    Direct direct;
    EACH_PACKET(k) path[k] = path_none();
#ifdef PATH_INSPECTED
    path[0].inspection = inspection_of(records);
#endif

    while (path_next_of_all(scene, pool, &waiting, path)) {
        scene_settings_again(scene, path[0].depth);

        // Find where each ray meets the scene; paths that met the same kind of material go on side by side
        EACH_SCENE(k) path_look(&scene[k], pool, &path[k]);
        path_find(scene, path, free, hit);
        EACH_PACKET(k) path_travel(scene_of(scene, k), &path[k], &free[k], &hit[k]);
        if (path_regroup(scene, path, hit)) EACH_SCENE(k) path_look(&scene[k], pool, &path[k]);
        else EACH_SCENE(k) path_choose_wavelength(&scene[k], &path[k]);

        // Add the light that the surface there sends out by itself, or the environment where there is none
        EACH_PACKET(k) {
            path_vertex(scene_of(scene, k), &path[k], hit[k], stats, &vertex[k]);
            path_add_emission(scene_of(scene, k), &path[k], &vertex[k]);
            path_add_sun(scene_of(scene, k), &path[k], &vertex[k]);
        }

#ifdef PATH_RECORDED
        EACH_PACKET(k) vertex[k].guide.before = path[k].radiance;
#endif
        // Sample light that reaches the surface straight from the lights, and where other light comes from, and go on there
        path_sample_direct(scene, path, vertex, &direct, stats);
        EACH_PACKET(k) chains_add(scene_of(scene, k), &path[k], &vertex[k], stats);
        EACH_PACKET(k) path_scatter(scene_of(scene, k), &path[k], &vertex[k], hit[k]);

        // Add the light of lights that nothing hides; deliver what paths that ended have found
        path_add_direct(scene, path, &direct);
#ifdef PATH_RECORDED
        EACH_PACKET(k) training_record(scene, pool, &path[k], &vertex[k], records);
#endif
        EACH_PACKET(k) path_deliver(scene_of(scene, k), pool, &path[k]);
    }
}

#endif
