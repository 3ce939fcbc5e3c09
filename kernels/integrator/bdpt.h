// Bidirectional path tracing (Lafortune and Willems 1993, Veach and Guibas 1994). Paths from the camera do what those of path.h do; beside that each
// vertex is joined with one of the vertices of a path from a light, drawn from those of the same sample of all pixels (Davidovič et al.,
// "Progressive light transport simulation on the GPU", ACM TOG 33(3) 2014). What a light path brings straight to the camera is splatted
// elsewhere (bidirectional/light_path.h). All ways to make a path share it by their weights (bidirectional/techniques.h).
#ifndef INTEGRATOR_BDPT_H
#define INTEGRATOR_BDPT_H

#define PATH_BIDIRECTIONAL
#define SHARED_TIME          // with the light paths of the same sample
#include "bidirectional/vertex.h"
#include "integrator/path.h"
#ifdef PATH_INSPECTED
#include "integrator/inspect_light.h"
#endif

// The light paths that were kept of this sample.
typedef struct {
    __global const float* vertices;      // [count][LIGHT_VERTICES][16]
    __global const uint* counts;
    uint count;
    uint pass;                           // the sample's number
} LightVertices;

// A vertex of a light path, as the path from the camera sees it, and what joining with it brings.
typedef struct {
    vec3 direction;          // towards it, unit
    vec3 radiance;           // from there, times the weight of this way
    LightSample end;         // for the shadow ray
} Join;

// The vertex of each lane that is asked for, and where it is: draw a light path, and one of its vertices. Returns how many it stands for.
static vfloat bdpt_draw(const LightVertices* light, const Path* path, vmask asked, vuint* number, vuint* place) {
    vuint bits_path, bits_vertex;
    sampler_hash_bits(path->sample.sampler, sampler_set(path->depth, SET_LOBE), &bits_path, &bits_vertex);
    *number = asked ? mul_hi(bits_path, splat_uint(light->count)) : splat_uint(0u);
    const vuint made = LANE_LOOK_UP(uint, light->counts, (*number)), kept = made < LIGHT_VERTICES ? made : splat_uint(LIGHT_VERTICES);
    *place = *number * LIGHT_VERTICES + mul_hi(bits_vertex, kept);
    return asked ? vfloat_of(vint_from_uint(made)) : splat(0.0f);
}

static Join bdpt_join(const Scene* scene, const LightVertices* light, Path* path, const Vertex* vertex, vmask* asked) {
    const Surface* here = &vertex->surface;
    vuint number, place;
    const vfloat stands_for = bdpt_draw(light, path, *asked, &number, &place);
    *asked = *asked & (stands_for > 0.0f);
    const LightVertex y = light_vertex_read(light->vertices, *asked ? place : splat_uint(0u));
    *asked = *asked & (y.depth + path->depth + 2u <= scene->settings->max_depth);

    // Make its surface and its BSDF again
    const Ray ray = ray_in_time(ray_make(y.origin, y.direction), ray_time(&path->ray));
    Surface there = surface_at(scene, &ray, y.hit, *asked & !medium_scatters(y.hit));
    surface_random(&there, light_path_sampler(scene, light->pass, number), y.depth);
    medium_surface(scene, &ray, &y.interior, y.hit, &there);
    interior_meet(scene, &y.interior, &there, *asked & !medium_scatters(y.hit));
    Bsdf bsdf;
    bsdf_at(scene, &there, y.direction, &bsdf);

    // What it scatters this way, and with which densities either path would have gone on to the other
    Join join;
    const vec3 to = sub(there.point, here->point);
    const vfloat distance2 = greater(inner(to, to), splat(1.0e-20f));
    join.direction = unit(to);
    const vec3 back = negate(join.direction), from = negate(y.direction), camera = negate(path->ray.direction);
    vfloat pdf, pdf_there, back_here, back_there;
    bsdf_eval(&bsdf, back, &pdf_there);
    const vec3 scattered = bsdf_reversed(scene, &there, &bsdf, from, back, *asked, &back_there);
    const vec3 f = bsdf_eval(&vertex->bsdf, join.direction, &pdf);
    *asked = *asked & (largest(mul(f, scattered)) > 0.0f);
    bsdf_reversed(scene, here, &vertex->bsdf, camera, join.direction, *asked, &back_here);

    const vfloat nearness = inverse_or_one(distance2);
    const vfloat reach = vertex_reached(scene, &path->interior, here, &vertex->bsdf, join.direction);
    const vfloat reach_there = vertex_reached(scene, &y.interior, &there, &bsdf, back);
    const vfloat by_camera = techniques_behind(&y.techniques, techniques_bounded(pdf * reach_there) * nearness, back_there);
    const vfloat by_light = techniques_behind(&path->techniques, techniques_bounded(pdf_there * reach) * nearness, back_here);
    const vfloat all = techniques_weight(by_camera + by_light, TECHNIQUES_JOIN_SHARE);
    const vfloat weight = techniques_only(all, path->depth + 2u, y.depth + 2u) * stands_for;
    const vfloat sides = vertex_cosine(&there, &bsdf, back) * nearness * inverse_or_one(vertex_cosine(&there, &bsdf, from));
    join.radiance = mul(mul(f, scattered), scale(y.flux, sides * weight));

    join.end.direction = join.direction;
    join.end.target = ray_end(here->point, there.point, there.normal, there.error);
    join.end.primitive = there.from;
    join.end.radiance = vec3_all(0.0f);
    join.end.pdf = splat(1.0f);
    join.end.delta = join.end.infinite = mask_none();
    inspect_join(scene, path, number, y.depth, stands_for, y.flux, there.point, join.direction, pdf, pdf_there, all);
    return join;
}

// For all packets: joins on their way.
static void bdpt_sample_joins(const Scene* scenes, const LightVertices* light, Path* path, const Vertex* vertex, Direct* joined, PoolStats* stats) {
    EACH_PACKET(k) {
        const Scene* scene = scene_of(scenes, k);
        joined->arriving[k] = vec3_all(0.0f);
        joined->shadow[k] = shadow_none();
        vmask asked = vertex[k].samples_lights & vertex[k].traced;
        if (!lane_any(asked)) continue;
        const Join join = bdpt_join(scene, light, &path[k], &vertex[k], &asked);
        const Interior in = interior_towards(&path[k].interior, &vertex[k].crossing, join.direction, vertex[k].bsdf.side);
        const vec3 left = shadow_straight(scene, &in, &join.end, vertex[k].surface.point);
        joined->arriving[k] = choose(asked, mul(mul(path[k].throughput, join.radiance), left), vec3_all(0.0f));
        joined->shadow[k] = shadow_ray(&vertex[k].surface, &join.end, &in);
        asked = path_asks(joined, k);
        stats->shadow_rays += lane_count(asked);
        stats->deepest = pool_deepest(stats->deepest, path[k].depth + 1u, asked);
#ifdef PATH_INSPECTED
        if (asked) inspect_joined_path(scene, &path[k], light->pass, joined->arriving[k]);
#endif
    }
}

static void bdpt_add_joins(const Scene* scene, Path* path, Direct* joined) {
    int any = 0;
    EACH_PACKET(k) any |= lane_any(path_asks(joined, k));
    inspect_joined(path);
    if (any) path_add_light(scene, path, joined);
}

static void bdpt_trace(const Scene* given, const LightVertices* light, Pool* pool, PoolStats* stats PATH_RECORDS) {
    Scene scene[SCENES];
    scenes_of(given, scene);
    CameraRays waiting = camera_rays_none();
    Path path[PACKETS];
    FreePath free[PACKETS];
    Hit hit[PACKETS];
    Vertex vertex[PACKETS];
    Direct direct, joined;
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

        // Add the light that the surface there sends out by itself, or the environment where there is none
        EACH_PACKET(k) {
            path_vertex(scene_of(scene, k), &path[k], hit[k], stats, &vertex[k]);
            path_add_emission(scene_of(scene, k), &path[k], &vertex[k]);
            path_add_sun(scene_of(scene, k), &path[k], &vertex[k]);
            path_arrive(scene_of(scene, k), &path[k], &vertex[k], hit[k]);
        }

        // Sample light that reaches the surface straight from the lights, and by way of light paths; and where other light comes from, and go on there
        path_sample_direct(scene, path, vertex, &direct, stats);
        bdpt_sample_joins(scene, light, path, vertex, &joined, stats);
        EACH_PACKET(k) chains_add(scene_of(scene, k), &path[k], &vertex[k], stats);
        EACH_PACKET(k) path_scatter(scene_of(scene, k), &path[k], &vertex[k], hit[k]);

        // Add the light that nothing hides; deliver what paths that ended have found
        path_add_direct(scene, path, &direct);
        bdpt_add_joins(scene, path, &joined);
        EACH_PACKET(k) path_deliver(scene_of(scene, k), pool, &path[k]);
    }
}

#endif
