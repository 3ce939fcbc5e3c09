// The weights of what a path finds, by its own way, by light samples, and by all ways that light paths have part in (bidirectional/techniques.h): the
// functions of path_weights.h.
#ifndef INTEGRATOR_BDPT_WEIGHTS_H
#define INTEGRATOR_BDPT_WEIGHTS_H

#include "bidirectional/techniques.h"
#include "bidirectional/vertex.h"
#include "integrator/path_state.h"
#include "integrator/shadow.h"
#include "integrator/vertex.h"
#include "light/light.h"

// Of a light that the ray ran into. `pdf` is the density of light samples there, per steradian. The ray has not arrived yet: what the cosine there
// would add to both densities is left out of both.
static vfloat path_weight_found(const Scene* scene, const Path* path, const LightRow* light, const Surface* surface, vfloat pdf) {
    const vmask outside = (light->kind == LIGHT_ENVIRONMENT) | sun_is(light);
    const vfloat radius = splat(scene->settings->bounds.w), density = techniques_bounded(pdf);
    const vfloat started = techniques_over(outside ? density : light->row[LIGHT_ROW_PROBABILITY], (outside ? radius * radius : light_area(light)) * PI);
    // Of light samples there is one for each path; joins, which the path has counted instead, have a share
    const vfloat sampled = path->techniques.edge * quotient_one(1.0f, TECHNIQUES_JOIN_SHARE) * density;
    const vfloat weight = techniques_weight(sampled + path->techniques.earlier * started, 1.0f);
    return techniques_only(weight, path->depth + 2u, splat_uint(0u));
}

// Of a light sample, which the BSDF would have found with this density.
static vfloat path_weight_sampled(const Scene* scene, const Path* path, const Vertex* vertex, const LightSample* light, vfloat bsdf_pdf) {
    vfloat back;
    const vmask asked = vertex->samples_lights & (light->pdf > 0.0f);
    bsdf_reversed(scene, &vertex->surface, &vertex->bsdf, negate(path->ray.direction), light->direction, asked, &back);
    const vfloat reach = vertex_reached(scene, &path->interior, &vertex->surface, &vertex->bsdf, light->direction);
    const vfloat started = techniques_behind(&path->techniques, techniques_bounded(light->started) * reach, back);
    const vfloat found = light->delta ? splat(0.0f) : techniques_over(bsdf_pdf, light->pdf);
    return techniques_only(techniques_weight(found + started, 1.0f), path->depth + 2u, splat_uint(1u));
}

// Emission that the camera sees counts in full; all other as its techniques say.
static void path_note_vertex(const Scene* scene, Path* path, const Vertex* vertex, vmask where) {
    path->counts_in_full = path->counts_in_full & !where;
}

// The path goes on in this direction.
static void path_note_direction(const Scene* scene, Path* path, const Vertex* v, const BsdfSample* next, vmask where) {
    const vmask straight = interior_straight(&v->crossing), delta = v->bsdf.specular | straight, lobes = where & v->scatters & !delta;
    const vfloat index_squared = straight ? splat(1.0f) : bsdf_index_squared(&v->bsdf, next->direction);
    const vfloat arrived = vertex_reach(scene, &path->interior, &v->surface, &v->bsdf, path->ray.direction);
    techniques_pass(&path->techniques, arrived, index_squared, where & delta);
    if (!lane_any(lobes)) return;
    vfloat back;
    bsdf_reversed(scene, &v->surface, &v->bsdf, negate(path->ray.direction), next->direction, lobes, &back);
    const vfloat reach = vertex_reached(scene, &path->interior, &v->surface, &v->bsdf, next->direction);
    techniques_scatter(&path->techniques, next->pdf, back, reach, !(v->dark & bsdf_in_medium(&v->bsdf)), !v->dark, lobes);
}

// The paths arrive at their vertices, once they have found the light there.
static void path_arrive(const Scene* scene, Path* path, const Vertex* v, Hit hit) {
    const vmask vertex = v->found & !shadow_passes(scene, interior_straight(&v->crossing));
    const vmask parallel = camera_is_parallel(scene) ? path->depth == 0u : mask_none();
    vfloat distance = hit.distance;
#ifdef STRAIGHT_SHADOWS
    distance = distance + path->passed;
#endif
    const vfloat reach = vertex_reach(scene, &path->interior, &v->surface, &v->bsdf, path->ray.direction);
    techniques_arrive(&path->techniques, distance, parallel, reach, vertex);
}

#endif
