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

// The path arrived at a surface, at a point of a medium, or outside of the scene.
static void inspect_surface(Path* path, vec3 carried, Hit hit, const Surface* surface, const Bsdf* bsdf, uint flags) {
    __global uint* row = path->inspection.vertex = inspect_row(path, INSPECT_VERTEX);
    path->inspection.light_sample = 0;
    if (!row) return;
    INSPECT_PUT_VEC3(row, INSPECT_VERTEX_ROW_ORIGIN, path->ray.origin);
    INSPECT_PUT_VEC3(row, INSPECT_VERTEX_ROW_ARRIVES, path->ray.direction);
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

// What a path found that ran into a light, by number; `weight` is that of its own way, and `pdf` the density of light samples.
static void inspect_found(const Scene* scene, Path* path, uint number, vec3 emitted, float pdf, float choice, float weight, vec3 counted) {
    __global uint* row = inspect_row(path, INSPECT_EMISSION);
    if (row) {
        const uint kind = inspect_light_kind(scene, number);
        const int infinite = kind == LIGHT_ENVIRONMENT || kind == LIGHT_SUN;
        const float other = path->counts_in_full ? 0.0f
                                                 : mis_weight((float)scene->settings->light_samples, pdf, path->bsdf_samples, path->bsdf_pdf);
        row[INSPECT_LIGHT_ROW_FLAGS] =
            INSPECT_ARRIVED | (path->counts_in_full ? INSPECT_IN_FULL : 0u) | (infinite ? INSPECT_INFINITE : 0u);
        row[INSPECT_LIGHT_ROW_LIGHT] = number;
        row[INSPECT_LIGHT_ROW_LIGHT_KIND] = kind;
        INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_DIRECTION, path->ray.direction);
        INSPECT_PUT_VEC3(row, INSPECT_LIGHT_ROW_EMITTED, emitted);
        INSPECT_PUT(row, INSPECT_LIGHT_ROW_LIGHT_PDF, pdf);
        INSPECT_PUT(row, INSPECT_LIGHT_ROW_CHOICE, choice);
        INSPECT_PUT(row, INSPECT_LIGHT_ROW_BSDF_PDF, path->bsdf_pdf);
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

// And a point of it; `arriving` is what it adds if nothing is in the way.
static void inspect_light_sample(const Scene* scene, Path* path, const Surface* surface, const LightSample* light, float bsdf_pdf,
                                 float bsdf_samples, float weight, vec3 arriving) {
    __global uint* row = path->inspection.light_sample = inspect_row(path, INSPECT_LIGHT_SAMPLE);
    if (!row) return;
    const float other = light->delta ? 0.0f : mis_weight(bsdf_samples, bsdf_pdf, (float)scene->settings->light_samples, light->pdf);
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
    INSPECT_PUT(row, INSPECT_LIGHT_ROW_BSDF_WEIGHT, other);
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
static void inspect_direction(Path* path, const Bsdf* bsdf, const BsdfSample* next) {
    __global uint* row = path->inspection.vertex;
    if (!row) return;
    INSPECT_PUT_VEC3(row, INSPECT_VERTEX_ROW_LEAVES, next->direction);
    INSPECT_PUT_VEC3(row, INSPECT_VERTEX_ROW_WEIGHT, next->weight);
    INSPECT_PUT(row, INSPECT_VERTEX_ROW_PDF, next->pdf);
    INSPECT_PUT(row, INSPECT_VERTEX_ROW_BSDF_PDF, next->pdf);
    if (inner(next->direction, bsdf->side) < 0.0f) row[INSPECT_VERTEX_ROW_FLAGS] |= INSPECT_CROSSES;
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

#endif

#endif
