// Paths from the lights. Each vertex that is no delta is seen by the camera, which is a splat, and kept for the paths from the camera to join with.
//
// Flux is weighed as radiance that goes the other way would be: BSDFs are those that a path from the camera sees (material/reversed.h), so that both
// kinds of paths find the same light even where a BSDF is not reciprocal, as with interpolated normals.
#ifndef BIDIRECTIONAL_LIGHT_PATH_H
#define BIDIRECTIONAL_LIGHT_PATH_H

#include "bidirectional/techniques.h"
#include "bidirectional/vertex.h"
#include "camera/shutter.h"
#include "camera/surroundings.h"
#include "camera/towards.h"
#include "core/roulette.h"
#include "film/splat.h"
#include "geometry/find.h"
#include "geometry/surface.h"
#include "integrator/inspect.h"
#include "integrator/shadow.h"
#include "material/bsdf.h"
#include "material/interior.h"
#include "material/turning.h"
#include "medium/flux.h"
#include "medium/walk.h"
#include "photon/emit.h"

typedef struct {
    vmask alive;
    vuint number;        // of the path
    Sampler sampler;
    Ray ray;
    vec3 flux;
    vuint depth;         // scattering events so far
    vuint made;          // vertices so far to join with
    vfloat passed;       // how far behind the ray's origin the last vertex is: surfaces in between were no boundaries
    vmask far;           // the last vertex is infinitely far
    vuint sphere;        // the light where the last vertex is on it, and light samples see a cone; else NONE
    Techniques techniques;
    Interior interior;   // the media that the ray begins in
#ifdef PATH_INSPECTED
    uint light;          // where it started, and where its next vertex is written down
    __global uint* row;
#endif
} LightPath;

// Where a path is.
typedef struct {
    Surface surface;
    Bsdf bsdf;
    Crossing crossing;
    vfloat arrived;      // vertex_cosine of where it came from
    vmask straight, dark;
    vmask scatters;      // the path may go on from it
    vmask joins;         // light goes from here to where it is asked for
} LightArrival;

static LightPath light_path_none(void) {
    LightPath p;
    p.alive = p.far = mask_none();
    p.interior = interior_none();
    p.number = p.depth = p.made = p.sampler.seed = p.sampler.index = splat_uint(0u);
    p.sphere = splat_uint(NONE);
    p.ray = ray_make(vec3_all(0.0f), vec3_all(1.0f));
    p.flux = vec3_all(0.0f);
    p.passed = splat(0.0f);
    p.techniques = techniques_none();
    return p;
}

static void light_path_start(const Scene* scene, uint pass, vuint number, vmask start, LightPath* p) {
    const Sampler own = light_path_sampler(scene, pass, number);
    p->number = start ? number : p->number;
    p->sampler.seed = start ? own.seed : p->sampler.seed;
    p->sampler.index = start ? own.index : p->sampler.index;
    const Emission e = emission_sample(scene, p->sampler, scene->settings->bounds, shutter_time_of_pass(scene, pass));
    ray_replace(&p->ray, e.ray, start);
    p->flux = choose(start, choose(e.far, mul(e.flux, interior_through_fog(scene)), e.flux), p->flux);
    p->depth = start ? splat_uint(0u) : p->depth;
    p->made = start ? splat_uint(0u) : p->made;
    p->passed = start ? splat(0.0f) : p->passed;
    p->far = start ? e.far : p->far;
    p->sphere = start ? e.sphere : p->sphere;
    p->techniques.edge = start ? techniques_bounded(e.spread) : p->techniques.edge;
    p->techniques.earlier = start ? techniques_bounded(e.extent) : p->techniques.earlier;
    interior_replace(&p->interior, interior_none(), start);
#ifdef LIGHTS_IN_MEDIA
    const vmask near = start & !e.far;
    if (lane_any(near)) interior_replace(&p->interior, surroundings_at(scene, e.ray.origin, near, ray_time(&e.ray)), near);
#endif
    p->alive = p->alive | start;
#ifdef PATH_INSPECTED
    p->light = e.light;
#endif
}

// Light samples see a sphere as a cone, with a density that depends on where from.
static void light_path_saw_sphere(const Scene* scene, LightPath* p, const LightArrival* a, vfloat reach, vmask where) {
    const vmask seen = where & (p->sphere != NONE);
    if (!lane_any(seen)) return;
    const LightRow l = light_at(scene, seen ? p->sphere : splat_uint(0u), ray_time(&p->ray));
    const vfloat radius = l.row[LIGHT_ROW_RADIUS], spread = sphere_spread(a->surface.point, vec3_row(l.row, LIGHT_ROW_CENTER), radius);
    const vfloat density = warp_cone_pdf(spread > 0.0f ? spread : splat(1.0f)), around = radius * radius * (4.0f * PI * PI);
    p->techniques.edge = seen ? techniques_over(spread > 0.0f ? techniques_bounded(density * around) : splat(0.0f), reach) : p->techniques.edge;
}

static void light_path_arrive(const Scene* scene, LightPath* p, Hit hit, LightArrival* a) {
    const vmask found = p->alive & (hit.primitive != NONE), on_surface = found & !medium_scatters(hit);
    a->surface = surface_at(scene, &p->ray, hit, on_surface);
    surface_random(&a->surface, p->sampler, p->depth);
    medium_surface(scene, &p->ray, &p->interior, hit, &a->surface);
    a->crossing = interior_meet(scene, &p->interior, &a->surface, on_surface);
    bsdf_at(scene, &a->surface, p->ray.direction, &a->bsdf);
    a->straight = interior_straight(&a->crossing);
    a->dark = walk_in_the_dark(scene, &p->interior, &a->crossing, &a->bsdf);
    a->scatters = found & ((p->depth < scene->settings->max_depth) | a->straight);
    a->joins = a->scatters & !(a->bsdf.specular | a->straight | a->dark);
    a->arrived = vertex_cosine(&a->surface, &a->bsdf, p->ray.direction);
    const vmask vertex = found & !shadow_passes(scene, a->straight);
    const vfloat reach = vertex_reach(scene, &p->interior, &a->surface, &a->bsdf, p->ray.direction);
    techniques_arrive(&p->techniques, p->passed + hit.distance, p->far, reach, vertex);
    light_path_saw_sphere(scene, p, a, reach, vertex);
    p->far = p->far & !vertex;
    p->sphere = vertex ? splat_uint(NONE) : p->sphere;
    p->passed = vertex ? splat(0.0f) : p->passed + hit.distance;
    inspect_light_arrival(p->row, &p->ray, p->flux, p->depth, hit, &a->surface, &a->bsdf, a->straight, a->dark, a->scatters, a->joins);
}

// Keep the vertex in the next free place of its path; when all are taken, in a random one or nowhere, so that at any time each vertex so far is as
// likely to be there (Vitter 1985).
static void light_path_keep(const LightPath* p, Hit hit, vmask where, __global float* vertices, uint most) {
    const vmask wanted = where & (p->number < most);
    if (!lane_any(wanted)) return;
    vuint random, unused;
    sampler_hash_bits(p->sampler, sampler_set(p->depth, SET_LOBE), &random, &unused);
    const vuint drawn = mul_hi(random, p->made + 1u), place = p->made < LIGHT_VERTICES ? p->made : drawn;
    const vmask kept = wanted & (place < LIGHT_VERTICES);
    LightVertex v;
    v.origin = p->ray.origin;
    v.direction = p->ray.direction;
    v.hit = hit;
    v.flux = p->flux;
    v.techniques = p->techniques;
    v.depth = p->depth;
    v.interior = p->interior;
    vfloat words[16];
    light_vertex_write(&v, words);
    int is_kept[LANES];
    uint at[LANES];
    float word[LANES];
    lane_store(kept, is_kept);
    lane_store((p->number * LIGHT_VERTICES + place), at);
    for (uint k = 0; k < 16u; ++k) {
        lane_store(words[k], word);
        for (int lane = 0; lane < LANES; ++lane)
            if (is_kept[lane]) vertices[(size_t)at[lane] * 16 + k] = word[lane];
    }
}

// What the camera sees of the vertex. Returns the shadow rays.
static uint light_path_splat(const Scene* scene, const LightPath* p, const LightArrival* a, const Splats* splats) {
    vmask seen = a->joins;
#ifdef HIDDEN_SHAPES
    seen = seen & !(a->surface.hidden | a->surface.held_out);
#endif
    if (!lane_any(seen)) return 0;
    vuint bits_u, bits_v;
    sampler_bits(p->sampler, sampler_set(p->depth, SET_LIGHT), &bits_u, &bits_v);
    const CameraView view = camera_towards(scene, a->surface.point, unit_interval(bits_u), unit_interval(bits_v), surface_time(&a->surface));
    sampler_hash_bits(p->sampler, sampler_set(p->depth, SET_LIGHT_DIGITS), &bits_u, &bits_v);
    const int wraps = scene->camera->kind == CAMERA_PANORAMIC;
    const SplatPlace place = splat_place(scene->settings, splats, wraps, view.film_x, view.film_y, unit_interval(bits_u), unit_interval(bits_v));
    seen = seen & (view.density > 0.0f) & (place.slot < splats->slot_count);
    if (!lane_any(seen)) return 0;

    // Radiance towards the camera, per flux that arrives; and how that counts among all ways to find it
    vfloat back;
    const vec3 from = negate(p->ray.direction);
    const vec3 f = bsdf_reversed(scene, &a->surface, &a->bsdf, from, view.direction, seen, &back);
    const float share = quotient_one(1.0f, (float)scene->settings->light_paths);
    const vfloat density = view.density * vertex_cosine(&a->surface, &a->bsdf, view.direction) * share;
    const vfloat reach = vertex_reached(scene, &p->interior, &a->surface, &a->bsdf, view.direction);
    const vfloat others = techniques_behind(&p->techniques, techniques_bounded(view.density * share) * reach, back);
    const vfloat weight = techniques_only(techniques_weight(others, 1.0f), splat_uint(1u), p->depth + 2u);
    const vec3 arriving = mul(p->flux, scale(f, inverse_or_one(a->arrived) * density * (weight * place.weight)));

    LightSample to;
    to.direction = view.direction;
    to.target = view.target;
    to.radiance = vec3_all(0.0f);
    to.pdf = splat(1.0f);
    to.primitive = splat_uint(NONE);
    to.delta = mask_all();
    to.infinite = mask_none();
    const Interior in = interior_towards(&p->interior, &a->crossing, view.direction, a->bsdf.side);
    const ShadowRay shadow = shadow_ray(&a->surface, &to, &in);
    vec3 left = mul(arriving, shadow_straight(scene, &in, &to, a->surface.point));
    const vmask asked = seen & (largest_size(left) > 0.0f);
    Shadows shadows;
    EACH_PACKET(k) shadow_start(scene, &shadows, k, &shadow, k == 0 ? asked : mask_none());
    shadow_finish(scene, &shadows);
    const vmask arrives = asked & shadow_arrives(&shadows, 0, &left);
    if (lane_any(arrives)) splat_add(splats, place.slot, color_of_film(scene, left), arrives, p->number, p->depth, weight);
    return lane_count(asked);
}

// Choose where the path goes on; it does with the probability of its largest weight, and its flux keeps its size. `sent`: its flux before it came
// here, of which a medium may have absorbed a part.
static vmask light_path_scatter(const Scene* scene, LightPath* p, const LightArrival* a, vec3 sent, Hit hit) {
    const Bsdf* bsdf = &a->bsdf;
    vuint bits_u, bits_v;
    sampler_bits(p->sampler, sampler_set(p->depth, SET_BSDF), &bits_u, &bits_v);
    BsdfSample next = bsdf_sample(bsdf, bits_u, bits_v);
    const vfloat index_squared = a->straight ? splat(1.0f) : bsdf_index_squared(bsdf, next.direction);
    vec3 weight = scale(next.weight, bsdf_turned(bsdf, p->ray.direction, next.direction) * index_squared);
    interior_straighten(&a->crossing, p->ray.direction, &next.direction, &weight);
    const vmask delta = bsdf->specular | a->straight, passes = shadow_passes(scene, a->straight), lobes = a->scatters & !delta;
    techniques_pass(&p->techniques, vertex_reach(scene, &p->interior, &a->surface, bsdf, p->ray.direction), index_squared, delta & !passes);
    if (lane_any(lobes)) {
        vfloat back;
        const vec3 f = bsdf_reversed(scene, &a->surface, bsdf, negate(p->ray.direction), next.direction, lobes, &back);
        const vfloat sides = vertex_cosine(&a->surface, bsdf, next.direction) * inverse_or_one(a->arrived * next.pdf);
        weight = choose(lobes, choose(largest(next.weight) > 0.0f, scale(f, sides), vec3_all(0.0f)), weight);
        const vfloat reach = vertex_reached(scene, &p->interior, &a->surface, bsdf, next.direction);
        techniques_scatter(&p->techniques, next.pdf, back, reach, !(a->dark & bsdf_in_medium(bsdf)), !a->dark, lobes);
    }

    const vfloat late = a->straight ? splat(1.0f) : roulette_late(p->depth + 1u);
    const vfloat open = medium_survival(scene, &p->interior, medium_scatters(hit), p->depth + 1u);
    const vfloat survival = roulette_by_flux(weight) * medium_kept(hit, sent, p->flux) * late * open;
    p->flux = mul(p->flux, scale(weight, inverse_or_one(survival)));
    p->ray = surface_leave(&a->surface, next.direction);
    interior_cross(&p->interior, &a->crossing, next.direction, bsdf->side);
    const vmask goes_on = interior_goes_on(&p->interior, &a->crossing, p->sampler, &p->flux);
    sampler_hash_bits(p->sampler, sampler_set(p->depth, SET_ROULETTE), &bits_u, &bits_v);
    inspect_light_scatter(p->row, bsdf, &next, weight, survival, unit_interval(bits_u), index_squared, p->flux);
    p->depth = a->straight ? p->depth : p->depth + 1u;
    return a->scatters & goes_on & ((p->depth < scene->settings->max_depth) | a->straight) & (unit_interval(bits_u) < survival);
}

// The paths [first, last) of a sample of all pixels. Vertices of the first `most` are kept; counts: how many there were, also of those not kept.
static uint light_paths_trace(const Scene* scene, const Splats* splats, uint pass, uint first, uint last, __global float* vertices,
                              __global uint* counts, uint most) {
    LightPath path = light_path_none();
    LightArrival arrival;
    uint next = first, rays = 0;

    for (;;) {
        // Lanes without a path start the next
        if (lane_any(!path.alive)) {
            const vuint number = next + lane_rank(!path.alive);
            const vmask start = !path.alive & (number < last);
            next += (uint)lane_count(!path.alive);
            if (lane_any(start)) light_path_start(scene, pass, number, start, &path);
            if (!lane_any(path.alive)) return rays;
        }

        // Find where each arrives, and what is left of it there
        const vec3 sent = path.flux;
        const Hit hit = flux_travel(scene, &path.interior, &path.ray, path.sampler, path.depth, path.alive, &path.flux);
        rays += lane_count(path.alive);
        light_path_arrive(scene, &path, hit, &arrival);

        // The camera may see it there, and other paths may join with it
        rays += light_path_splat(scene, &path, &arrival, splats);
        light_path_keep(&path, hit, arrival.joins, vertices, most);
        path.made = arrival.joins ? path.made + 1u : path.made;

        // Go on, or end and say how many vertices there were
        const vmask ended = path.alive & !light_path_scatter(scene, &path, &arrival, sent, hit);
        if (lane_any(ended)) {
            int has_ended[LANES];
            uint number[LANES], count[LANES];
            lane_store(ended, has_ended);
            lane_store(path.number, number);
            lane_store(path.made, count);
            for (int lane = 0; lane < LANES; ++lane)
                if (has_ended[lane] && number[lane] < most) counts[number[lane]] = count[lane];
        }
        path.alive = path.alive & !ended;
    }
}

#endif
