// Paths written down for people to look at (clrender/inspection): a row for each vertex and for each addition to the radiance, with the numbers that the
// integrator computed there. It is the integrator that is inspected, not another one: these functions only write what they are given.
//
// Without PATH_INSPECTED all of them are nothing, and programs are those that they were.
#ifndef INTEGRATOR_INSPECT_H
#define INTEGRATOR_INSPECT_H

#ifdef PATH_INSPECTED

#include "core/mis.h"
#include "integrator/path_state.h"
#include "integrator/vertex.h"
#include "light/light.h"
#include "medium/homogeneous.h"
#include "spectral/color.h"

#define INSPECT_PUT(row, column, value) (row)[column] = as_uint(value)
#define INSPECT_PUT_VEC3(row, column, value) \
    INSPECT_PUT(row, (column), (value).x), INSPECT_PUT(row, (column) + 1, (value).y), INSPECT_PUT(row, (column) + 2, (value).z)

// The next row of a path, all zero but for its kind; 0 where there is none left.
static __global uint* inspect_row(Path* path, uint kind) {
    const uint at = path->inspection.used++;
    if (at >= INSPECT_ROWS) return 0;
    __global uint* row = path->inspection.rows + at * INSPECT_WORDS;
    for (uint k = 0; k < INSPECT_WORDS; ++k) row[k] = 0u;
    row[INSPECT_VERTEX_ROW_KIND] = kind;
    row[INSPECT_VERTEX_ROW_DEPTH] = path->depth;
    return row;
}

// Something was added to the path's radiance.
static void inspect_added(const Scene* scene, Path* path, __global uint* row, vec3 added) {
    ++path->inspection.additions;
    if (!row) {
        path->inspection.rest = add(path->inspection.rest, added);
        return;
    }
    row[INSPECT_LIGHT_ROW_ORDER] = path->inspection.additions;
    const vec3 color = color_of_film(scene, added);
    INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_ADDED, added);
    INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_COLOR, color);
}

static uint inspect_light_kind(const Scene* scene, uint light) {
    return as_uint(scene->light_rows[light * 16u + LIGHT_ROW_KIND]) & ((1u << LIGHT_TEXTURE) - 1u);
}

// A path with this ray arrived at a surface, at a point of a medium, or outside of the scene.
static void inspect_arrived(__global uint* row, const Ray* ray, vec3 carried, Hit hit, const Surface* surface, const Bsdf* bsdf, uint flags) {
    if (!row) return;
    INSPECT_PUT_VEC3(row, INSPECT_VERTEX_ROW_ORIGIN, ray->origin);
    INSPECT_PUT_VEC3(row, INSPECT_VERTEX_ROW_ARRIVES, ray->direction);
    INSPECT_PUT_VEC3(row, INSPECT_VERTEX_ROW_BEFORE, carried);
    INSPECT_PUT(row, INSPECT_VERTEX_ROW_SURVIVAL, 1.0f);
    INSPECT_PUT(row, INSPECT_VERTEX_ROW_LIGHT_SHARE, 1.0f);
    row[INSPECT_VERTEX_ROW_LIGHT] = NONE;
    row[INSPECT_VERTEX_ROW_FLAGS] = flags;
    if (!(flags & INSPECT_FOUND)) return;
    row[INSPECT_VERTEX_ROW_FLAGS] |= (surface->front ? INSPECT_FRONT : 0u) | (bsdf->specular ? INSPECT_SPECULAR : 0u);
    row[INSPECT_VERTEX_ROW_PRIMITIVE] = surface->primitive;
    row[INSPECT_VERTEX_ROW_MATERIAL] = surface->kind;
    row[INSPECT_VERTEX_ROW_LIGHT] = surface->light;
    INSPECT_PUT(row, INSPECT_VERTEX_ROW_DISTANCE, hit.distance);
    INSPECT_PUT_VEC3(row, INSPECT_VERTEX_ROW_POINT, surface->point);
    INSPECT_PUT_VEC3(row, INSPECT_VERTEX_ROW_NORMAL, surface->normal);
    INSPECT_PUT_VEC3(row, INSPECT_VERTEX_ROW_SHADING, bsdf->frame.normal);
}
static void inspect_surface(Path* path, vec3 carried, Hit hit, const Surface* surface, const Bsdf* bsdf, uint flags) {
    path->inspection.vertex = inspect_row(path, INSPECT_VERTEX);
    path->inspection.light_sample = 0;
#ifdef PATH_BIDIRECTIONAL
    path->inspection.join = 0;
    path->inspection.straight = (flags & INSPECT_STRAIGHT) != 0u;
#endif
    inspect_arrived(path->inspection.vertex, &path->ray, carried, hit, surface, bsdf, flags);
}

static void inspect_vertex(Path* path, Hit hit, const Vertex* v) {
    const uint where = (v->found | !v->traced ? INSPECT_FOUND : 0u) | (bsdf_in_medium(&v->bsdf) ? INSPECT_IN_MEDIUM : 0u);
    const uint how = (v->traced ? 0u : INSPECT_BACK) | (interior_straight(&v->crossing) ? INSPECT_STRAIGHT : 0u) | (v->dark ? INSPECT_DARK : 0u);
    const uint what = (v->samples_lights ? INSPECT_SAMPLES_LIGHTS : 0u) | (v->scatters ? INSPECT_SCATTERS : 0u);
    inspect_surface(path, split_throughput(&path->split, path->throughput), hit, &v->surface, &v->bsdf, where | how | what);
#ifdef PATH_GUIDED
    __global uint* row = path->inspection.vertex;
    if (!row) return;
    INSPECT_PUT(row, INSPECT_VERTEX_ROW_SHARE, v->guide.share);
    INSPECT_PUT(row, INSPECT_VERTEX_ROW_LIGHT_SHARE, v->guide.light);
    if (v->guide.share > 0.0f) row[INSPECT_VERTEX_ROW_FLAGS] |= INSPECT_GUIDED;
#endif
}

// Of a medium that shines: it is added here, and not where it is found (path_travel).
static void inspect_glow(const Scene* scene, Path* path, vec3 glow) {
    path->radiance = add(path->radiance, glow);
    if (glow.x == 0.0f && glow.y == 0.0f && glow.z == 0.0f) return;
    __global uint* row = inspect_row(path, INSPECT_GLOW);
    if (row) {
        row[INSPECT_LIGHT_ROW_LIGHT] = NONE;
        row[INSPECT_LIGHT_ROW_FLAGS] = INSPECT_ARRIVED | INSPECT_IN_FULL;
        INSPECT_PUT(row, INSPECT_LIGHT_ROW_BSDF_WEIGHT, 1.0f);
        INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_UNSHADOWED, glow);
        INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_THROUGHPUT, path->throughput);
    }
    inspect_added(scene, path, row, glow);
}

// The weight of the other strategy of two. A path that is made in more ways has one for each of them (bidirectional/techniques.h), and only that of
// its own way is written down.
#ifdef PATH_BIDIRECTIONAL
#define inspect_found_pdf(path) (path)->inspection.bsdf_pdf
#define inspect_weight_of_light_samples(scene, path, pdf) 0.0f
#define inspect_weight_of_bsdf(scene, bsdf_samples, bsdf_pdf, pdf) 0.0f
#else
#define inspect_found_pdf(path) (path)->bsdf_pdf
#define inspect_weight_of_light_samples(scene, path, pdf) \
    mis_weight((float)(scene)->settings->light_samples, pdf, (path)->bsdf_samples, (path)->bsdf_pdf)
#define inspect_weight_of_bsdf(scene, bsdf_samples, bsdf_pdf, pdf) mis_weight(bsdf_samples, bsdf_pdf, (float)(scene)->settings->light_samples, pdf)
#endif

// What a path found that ran into a light, by number; `weight` is that of its own way, and `pdf` the density of light samples.
static void inspect_found(const Scene* scene, Path* path, uint number, vec3 emitted, float pdf, float choice, float weight, vec3 counted) {
    __global uint* row = inspect_row(path, INSPECT_EMISSION);
    if (row) {
        const uint kind = inspect_light_kind(scene, number);
        const int infinite = kind == LIGHT_ENVIRONMENT || kind == LIGHT_SUN;
        const float other = path->counts_in_full ? 0.0f : inspect_weight_of_light_samples(scene, path, pdf);
        row[INSPECT_LIGHT_ROW_FLAGS] =
            INSPECT_ARRIVED | (path->counts_in_full ? INSPECT_IN_FULL : 0u) | (infinite ? INSPECT_INFINITE : 0u);
        row[INSPECT_LIGHT_ROW_LIGHT] = number;
        row[INSPECT_LIGHT_ROW_LIGHT_KIND] = kind;
        INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_DIRECTION, path->ray.direction);
        INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_EMITTED, emitted);
        INSPECT_PUT(row, INSPECT_LIGHT_ROW_LIGHT_PDF, pdf);
        INSPECT_PUT(row, INSPECT_LIGHT_ROW_CHOICE, choice);
        INSPECT_PUT(row, INSPECT_LIGHT_ROW_BSDF_PDF, inspect_found_pdf(path));
        INSPECT_PUT(row, INSPECT_LIGHT_ROW_LIGHT_WEIGHT, other);
        INSPECT_PUT(row, INSPECT_LIGHT_ROW_BSDF_WEIGHT, path->counts_in_full ? 1.0f : weight);
        INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_UNSHADOWED, counted);
        INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_THROUGHPUT, path->throughput);
    }
    inspect_added(scene, path, row, counted);
}
static void inspect_emission(const Scene* scene, Path* path, const LightRow* light, const Surface* surface, vec3 emitted, float density,
                             float pdf, float weight, vec3 counted, vmask where) {
    if (!where) return;
    uint number = light->kind == LIGHT_ENVIRONMENT ? scene->settings->environment : surface->light;
#ifdef SUN
    if (light->kind == LIGHT_SUN) number = sun_light(scene);
#endif
    inspect_found(scene, path, number, emitted, pdf, pdf * inverse_or_one(density), weight, counted);
}

// A light was chosen for the next light sample.
static void inspect_choice(const Scene* scene, Path* path, const LightChoice* choice) {
    path->inspection.light = choice->light;
    path->inspection.choice =
        scene->settings->light_levels > 0 ? choice->probability : scene->light_rows[choice->light * 16u + LIGHT_ROW_PROBABILITY];
}

// And a point of it; `other` is the weight of directions of the BSDF, and `arriving` what it adds if nothing is in the way.
#define inspect_light_sample(scene, path, surface, light, bsdf_pdf, bsdf_samples, weight, arriving) \
    inspect_sampled(scene, path, light, bsdf_pdf, inspect_weight_of_bsdf(scene, bsdf_samples, bsdf_pdf, (light)->pdf), weight, arriving)
static void inspect_sampled(const Scene* scene, Path* path, const LightSample* light, float bsdf_pdf, float other, float weight, vec3 arriving) {
    __global uint* row = path->inspection.light_sample = inspect_row(path, INSPECT_LIGHT_SAMPLE);
    if (!row) return;
    const int asked = light->pdf > 0.0f && largest(arriving) > 0.0f;
    row[INSPECT_LIGHT_ROW_FLAGS] = (asked ? INSPECT_ASKED : 0u) | (light->delta ? INSPECT_DELTA : 0u) | (light->infinite ? INSPECT_INFINITE : 0u);
    row[INSPECT_LIGHT_ROW_LIGHT] = path->inspection.light;
    row[INSPECT_LIGHT_ROW_LIGHT_KIND] = inspect_light_kind(scene, path->inspection.light);
    INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_TARGET, light->target);
    INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_DIRECTION, light->direction);
    INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_EMITTED, light->radiance);
    INSPECT_PUT(row, INSPECT_LIGHT_ROW_LIGHT_PDF, light->pdf);
    INSPECT_PUT(row, INSPECT_LIGHT_ROW_CHOICE, path->inspection.choice);
    INSPECT_PUT(row, INSPECT_LIGHT_ROW_BSDF_PDF, bsdf_pdf);
    INSPECT_PUT(row, INSPECT_LIGHT_ROW_LIGHT_WEIGHT, weight);
    INSPECT_PUT(row, INSPECT_LIGHT_ROW_BSDF_WEIGHT, light->delta ? 0.0f : other);
    INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_THROUGHPUT, path->throughput);
    if (asked) INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_UNSHADOWED, arriving);
}

// Its shadow ray was traced.
static void inspect_arrival(const Scene* scene, Path* path, vmask arrives, vec3 arriving) {
    if (!arrives) return;
    __global uint* row = path->inspection.light_sample;
    if (row) row[INSPECT_LIGHT_ROW_FLAGS] |= INSPECT_ARRIVED;
    inspect_added(scene, path, row, arriving);
}

// What specular chains bring to the vertex. Returns it.
static vec3 inspect_chain(const Scene* scene, Path* path, vec3 brought) {
    if (brought.x == 0.0f && brought.y == 0.0f && brought.z == 0.0f) return brought;
    __global uint* row = inspect_row(path, INSPECT_CHAIN);
    if (row) {
        row[INSPECT_LIGHT_ROW_FLAGS] = INSPECT_ARRIVED;
        row[INSPECT_LIGHT_ROW_LIGHT] = NONE;
        INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_UNSHADOWED, brought);
        INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_THROUGHPUT, path->throughput);
    }
    inspect_added(scene, path, row, brought);
    return brought;
}

// The direction in which the path goes on from its vertex.
static void inspect_left(__global uint* row, const Bsdf* bsdf, const BsdfSample* next, vec3 weight) {
    if (!row) return;
    INSPECT_PUT_VEC3(row, INSPECT_VERTEX_ROW_LEAVES, next->direction);
    INSPECT_PUT_VEC3(row, INSPECT_VERTEX_ROW_WEIGHT, weight);
    INSPECT_PUT(row, INSPECT_VERTEX_ROW_PDF, next->pdf);
    INSPECT_PUT(row, INSPECT_VERTEX_ROW_BSDF_PDF, next->pdf);
    if (inner(next->direction, bsdf->side) < 0.0f) row[INSPECT_VERTEX_ROW_FLAGS] |= INSPECT_CROSSES;
}
static void inspect_direction(Path* path, const Bsdf* bsdf, const BsdfSample* next) {
#ifdef PATH_BIDIRECTIONAL
    if (!path->inspection.straight) path->inspection.bsdf_pdf = next->pdf;
#endif
    inspect_left(path->inspection.vertex, bsdf, next, next->weight);
}
static void inspect_guided(Path* path, const Vertex* v) {
#ifdef PATH_GUIDED
    __global uint* row = path->inspection.vertex;
    if (!row) return;
    INSPECT_PUT(row, INSPECT_VERTEX_ROW_BSDF_PDF, v->guide.bsdf_pdf);
    if (v->guide.share > 0.0f && v->guide.chosen) row[INSPECT_VERTEX_ROW_FLAGS] |= INSPECT_BY_FIELD;
#endif
}

// Before roulette: whether the path still may go on.
static void inspect_carries(Path* path, vmask carries) {
    if (path->inspection.vertex && carries) path->inspection.vertex[INSPECT_VERTEX_ROW_FLAGS] |= INSPECT_CARRIES;
}
// Roulette: the path goes on if the random number is below its survival.
static void inspect_roulette(Path* path, float survival, float random) {
    __global uint* row = path->inspection.vertex;
    if (!row) return;
    row[INSPECT_VERTEX_ROW_FLAGS] |= INSPECT_ROULETTE;
    INSPECT_PUT(row, INSPECT_VERTEX_ROW_SURVIVAL, survival);
    INSPECT_PUT(row, INSPECT_VERTEX_ROW_RANDOM, random);
}
// After it.
static void inspect_leaves(Path* path, vmask goes_on) {
    __global uint* row = path->inspection.vertex;
    if (!row) return;
    if (goes_on) row[INSPECT_VERTEX_ROW_FLAGS] |= INSPECT_GOES_ON;
    INSPECT_PUT_VEC3(row, INSPECT_VERTEX_ROW_AFTER, path->throughput);
    INSPECT_PUT(row, INSPECT_VERTEX_ROW_INDEX, path->index_squared);
}

#ifdef PATH_BIDIRECTIONAL

// A vertex of a light path was drawn to connect with: after `depth` events of path `number`, with the flux that arrives there. It stands for so many
// vertices of its path, and `weight` is that of this way among all; densities are those with which either path would have gone on to the other.
static void inspect_join(const Scene* scene, Path* path, uint number, uint depth, float stands_for, vec3 flux, vec3 point, vec3 direction,
                         float bsdf_pdf, float light_pdf, float weight) {
    path->inspection.join = 0;
    if (!(stands_for > 0.0f) || depth + path->depth + 2u > scene->settings->max_depth) return;
    __global uint* row = path->inspection.join = inspect_row(path, INSPECT_JOIN);
    path->inspection.joined = number;
    path->inspection.joined_depth = depth;
    if (!row) return;
    row[INSPECT_LIGHT_ROW_LIGHT] = NONE;
    INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_TARGET, point);
    INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_DIRECTION, direction);
    INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_EMITTED, flux);
    INSPECT_PUT(row, INSPECT_LIGHT_ROW_LIGHT_PDF, light_pdf);
    INSPECT_PUT(row, INSPECT_LIGHT_ROW_BSDF_PDF, bsdf_pdf);
    INSPECT_PUT(row, INSPECT_LIGHT_ROW_BSDF_WEIGHT, weight);
    INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_THROUGHPUT, path->throughput);
    row[INSPECT_LIGHT_ROW_PATH] = number;
    row[INSPECT_LIGHT_ROW_EVENTS] = depth;
    INSPECT_PUT(row, INSPECT_LIGHT_ROW_STANDS_FOR, stands_for);
}

// The connection's ray is traced, for this radiance.
static void inspect_join_asked(Path* path, vec3 arriving) {
    __global uint* row = path->inspection.join;
    if (!row) return;
    row[INSPECT_LIGHT_ROW_FLAGS] |= INSPECT_ASKED;
    INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_UNSHADOWED, arriving);
}

// What arrives next is that of the connection.
static void inspect_joined(Path* path) { path->inspection.light_sample = path->inspection.join; }

// Light paths: the light that one starts from, where it arrives, and how it goes on.
static void inspect_light_start(const Scene* scene, __global uint* row, const Ray* ray, vec3 flux, uint light, vmask far) {
    if (!row) return;
    row[INSPECT_VERTEX_ROW_FLAGS] = far ? 0u : INSPECT_FOUND;
    row[INSPECT_VERTEX_ROW_LIGHT] = light;
    row[INSPECT_VERTEX_ROW_MATERIAL] = inspect_light_kind(scene, light);
    INSPECT_PUT_VEC3(row, INSPECT_VERTEX_ROW_POINT, ray->origin);
    INSPECT_PUT_VEC3(row, INSPECT_VERTEX_ROW_LEAVES, ray->direction);
    INSPECT_PUT_VEC3(row, INSPECT_VERTEX_ROW_AFTER, flux);
}
static void inspect_light_arrival(__global uint* row, const Ray* ray, vec3 flux, uint depth, Hit hit, const Surface* surface, const Bsdf* bsdf,
                                  vmask straight, vmask dark, vmask scatters, vmask joins) {
    const uint where = INSPECT_FOUND | (bsdf_in_medium(bsdf) ? INSPECT_IN_MEDIUM : 0u) | (straight ? INSPECT_STRAIGHT : 0u);
    const uint what = (dark ? INSPECT_DARK : 0u) | (scatters ? INSPECT_SCATTERS : 0u) | (joins ? INSPECT_SAMPLES_LIGHTS : 0u);
    inspect_arrived(row, ray, flux, hit, surface, bsdf, where | what);
    if (row) row[INSPECT_VERTEX_ROW_DEPTH] = depth;
}
static void inspect_light_scatter(__global uint* row, const Bsdf* bsdf, const BsdfSample* next, vec3 weight, float survival, float random,
                                  float index_squared, vec3 flux) {
    inspect_left(row, bsdf, next, weight);
    if (!row) return;
    row[INSPECT_VERTEX_ROW_FLAGS] |= INSPECT_CARRIES | INSPECT_ROULETTE | INSPECT_GOES_ON;
    INSPECT_PUT(row, INSPECT_VERTEX_ROW_SURVIVAL, survival);
    INSPECT_PUT(row, INSPECT_VERTEX_ROW_RANDOM, random);
    INSPECT_PUT_VEC3(row, INSPECT_VERTEX_ROW_AFTER, flux);
    INSPECT_PUT(row, INSPECT_VERTEX_ROW_INDEX, index_squared);
}

#endif

// The sample is complete, and about to be delivered.
static void inspect_end(const Scene* scene, const Pool* pool, const Path* path, vmask done) {
    if (!done) return;
    __global uint* head = path->inspection.rows;
    for (uint k = 0; k < INSPECT_WORDS; ++k) head[k] = 0u;
    const vec3 value = pool_weighted(pool, &path->sample, color_of_film(scene, path->radiance));
    const vec3 one = pool_weighted(pool, &path->sample, vec3_all(1.0f));
    head[INSPECT_SAMPLE_ROW_USED] = path->inspection.used;
    head[INSPECT_SAMPLE_ROW_DEPTH] = path->depth;
    head[INSPECT_SAMPLE_ROW_ENDS] = 1u;
    INSPECT_PUT_VEC3(head, INSPECT_SAMPLE_ROW_RADIANCE, path->radiance);
    INSPECT_PUT_VEC3(head, INSPECT_SAMPLE_ROW_VALUE, value);
    INSPECT_PUT_VEC3(head, INSPECT_SAMPLE_ROW_REST, path->inspection.rest);
    INSPECT_PUT(head, INSPECT_SAMPLE_ROW_FILTER, one.x);
    INSPECT_PUT(head, INSPECT_SAMPLE_ROW_TIME, ray_time(&path->ray));
#ifdef SPECTRAL
    const vec3 lines = scene->wavelengths.lines;
    INSPECT_PUT_VEC3(head, INSPECT_SAMPLE_ROW_WAVELENGTHS, along(vec3_all(360.0f), lines, 5.0f));
#endif
}

// The same of Whitted's ray tracing, which has no densities: `seen` is the light that the surface, or the environment, sends out.
static void inspect_whitted(const Scene* scene, Path* path, Hit hit, vmask found, vmask escapes, const Surface* surface, const Bsdf* bsdf,
                            vmask straight, vmask scatters, vec3 seen) {
    const uint what = (found ? INSPECT_FOUND : 0u) | (straight ? INSPECT_STRAIGHT : 0u) | (scatters ? INSPECT_SCATTERS : 0u);
    inspect_surface(path, path->throughput, hit, surface, bsdf, what | (scatters & !(bsdf->specular | straight) ? INSPECT_SAMPLES_LIGHTS : 0u));
    const int environment = escapes && scene->settings->environment != NONE;
    if (!(environment || (found && surface->light != NONE)) || (seen.x == 0.0f && seen.y == 0.0f && seen.z == 0.0f)) return;
    const float inverse = inverse_or_one(largest(path->throughput));
    inspect_found(scene, path, environment ? scene->settings->environment : surface->light, scale(seen, inverse), 0.0f, 0.0f, 1.0f, seen);
}
static void inspect_center(const Scene* scene, Path* path, const Surface* surface, uint number, const LightSample* light, vec3 direct,
                           vmask asked, float left) {
    path->inspection.light = number;
    path->inspection.choice = 1.0f;
    inspect_light_sample(scene, path, surface, light, 0.0f, 0.0f, 1.0f, mul(path->throughput, direct));
    inspect_arrival(scene, path, asked & (left > 0.0f), scale(mul(path->throughput, direct), left));
}

#else

#define inspect_vertex(path, hit, v)
#define inspect_emission(scene, path, light, surface, emitted, density, pdf, weight, counted, where)
#define inspect_choice(scene, path, choice)
#define inspect_light_sample(scene, path, surface, light, bsdf_pdf, bsdf_samples, weight, arriving)
#define inspect_arrival(scene, path, arrives, arriving)
#define inspect_chain(scene, path, brought) brought
#define inspect_direction(path, bsdf, next)
#define inspect_guided(path, v)
#define inspect_carries(path, carries)
#define inspect_roulette(path, survival, random)
#define inspect_leaves(path, goes_on)
#define inspect_end(scene, pool, path, done)
#define inspect_whitted(scene, path, hit, found, escapes, surface, bsdf, straight, scatters, seen)
#define inspect_center(scene, path, surface, number, light, direct, asked, left)
#define inspect_join(scene, path, number, depth, stands_for, flux, point, direction, bsdf_pdf, light_pdf, weight)
#define inspect_joined(path)
#define inspect_light_arrival(row, ray, flux, depth, hit, surface, bsdf, straight, dark, scatters, joins)
#define inspect_light_scatter(row, bsdf, next, weight, survival, random, index_squared, flux)

#endif

#endif
