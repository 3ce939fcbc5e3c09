// The weights of what a path finds, by light samples and by its own way: the balance heuristic (Veach 1997).
#ifndef INTEGRATOR_PATH_WEIGHTS_H
#define INTEGRATOR_PATH_WEIGHTS_H

#include "core/mis.h"
#include "integrator/path_state.h"
#include "integrator/vertex.h"
#include "light/light.h"

// The weight of a light that the ray ran into; `pdf` is the density of light samples there.
static vfloat path_weight_found(const Scene* scene, const Path* path, const LightRow* light, const Surface* surface, vfloat pdf) {
    return mis_weight(path->bsdf_samples, path->bsdf_pdf, splat((float)scene->settings->light_samples), pdf);
}

#ifdef PATH_GATHERS
// Where photons are gathered.
static vmask path_gathers(const Vertex* vertex) {
    return (vertex->surface.kind == MATERIAL_LAMBERT) | (bsdf_in_medium(&vertex->bsdf) & !vertex->dark);
}
#endif

// How many of the BSDF's samples the MIS weights count at a vertex. Photon mapping has none where photons are gathered, and elsewhere one.
static vfloat path_bsdf_samples(const Scene* scene, const Path* path, const Vertex* vertex) {
#if defined(PATH_GATHERS) && (defined(MATERIALS) || defined(MEDIA))
    return path_gathers(vertex) ? splat(0.0f) : splat(1.0f);
#else
    return split_bsdf_samples(&path->split, scene->settings->bsdf_samples);
#endif
}

// The weight of a light sample, which the BSDF would have found with this density.
static vfloat path_weight_sampled(const Scene* scene, const Path* path, const Vertex* vertex, const LightSample* light, vfloat bsdf_pdf) {
    const vfloat bsdf_samples = path_bsdf_samples(scene, path, vertex);
    const vfloat weight = mis_weight(splat((float)scene->settings->light_samples), light->pdf, bsdf_samples, bsdf_pdf);
    return light->delta ? splat(1.0f) : weight;
}

// Note for the emission that is met next how light sampling could have found it from here: not at all after a delta.
static void path_note_vertex(const Scene* scene, Path* path, const Vertex* vertex, vmask where) {
    const vmask unseen = vertex->bsdf.specular | interior_straight(&vertex->crossing) | vertex->dark;
    path->counts_in_full = where ? unseen : path->counts_in_full;
    path->bsdf_samples = where ? path_bsdf_samples(scene, path, vertex) : path->bsdf_samples;
}
static void path_note_direction(const Scene* scene, Path* path, const Vertex* vertex, const BsdfSample* next, vmask where) {
    path->bsdf_pdf = where ? next->pdf : path->bsdf_pdf;
}

#endif
