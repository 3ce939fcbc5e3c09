// Specular chains in paths: at their vertices light is sampled that comes over one or two deltas (specular/walk.h), and a path that finds such light by
// itself shares it with that, by weights.
//
// `bdpt` finds most of these by its light paths. It takes chains only where those cannot: at the first vertex that is no delta, where the camera
// sees it over deltas alone.
//
// Without SPECULAR_CHAINS all of this is nothing.
#ifndef SPECULAR_CHAINS_H
#define SPECULAR_CHAINS_H

#include "film/pool.h"
#include "integrator/inspect.h"
#include "integrator/path_state.h"
#include "integrator/vertex.h"

#ifdef SPECULAR_CHAINS
#include "specular/walk.h"

// At which vertices chains begin.
static vmask chains_begin(const Path* path, const Vertex* v) {
#ifdef PATH_BIDIRECTIONAL
    return v->samples_lights & (path->chain.kind == CHAIN_CAMERA) & (path->depth > 0u);
#else
    return v->samples_lights;
#endif
}

// The path goes on from the vertex in this direction: before its ray and its throughput are those that it goes on with.
static void chains_note(const Scene* scene, Path* path, const Vertex* v, const BsdfSample* next) {
    ChainState* chain = &path->chain;
    const vmask straight = interior_straight(&v->crossing), delta = v->bsdf.specular & !straight, begins = chains_begin(path, v);
    const vmask in_one = delta & delta_in_chain(&v->surface, &v->bsdf, path->ray.direction) & (chain->kind < CHAIN_CAMERA) &
                         (chain_kind_count(chain->kind) < SPECULAR_MOST);
    const vmask through = delta_passed(&v->bsdf, next->direction);
    const vfloat distance = magnitude(sub(v->surface.point, path->ray.origin));
    if (lane_any(in_one)) {
        differential_meet(scene, &chain->by, &v->surface, &v->bsdf, path->ray.direction, distance, through, in_one);
        chain->pdf = in_one ? chain->pdf * delta_chosen(&v->bsdf, through) : chain->pdf;
    }
    differential_advance(&chain->by, distance, straight);
    const Differential first = differential_begin(next->direction);
    for (int i = 0; i < 2; ++i) {
        chain->by.point[i] = choose(begins, first.point[i], chain->by.point[i]);
        chain->by.direction[i] = choose(begins, first.direction[i], chain->by.direction[i]);
    }
    chain->pdf = begins ? next->pdf : chain->pdf;
    chain->chance = begins ? walk_chance(path) : chain->chance;
    const vuint on_one = in_one ? chain_kind_with(chain->kind, through) : splat_uint(CHAIN_NONE);
    const vuint after = begins ? splat_uint(0u) : delta & (chain->kind == CHAIN_CAMERA) ? chain->kind : on_one;
    chain->kind = straight ? chain->kind : after;
}

// The share of the emission that the path finds at a point of a light, or of the sun, which chains leave to it. `pdf`: density of the points of that light,
// per square metre, or of its directions.
static vfloat chains_leave(const Scene* scene, const Path* path, vuint light, vfloat pdf, vfloat cosine, vfloat distance, vmask infinite, vmask where) {
    const ChainState* chain = &path->chain;
    const vmask over = where & (chain->kind < CHAIN_CAMERA) & (chain_kind_count(chain->kind) > 0u);
    if (!lane_any(over)) return splat(1.0f);
    const vfloat nearness = infinite ? splat(0.0f) : inverse_or_one(distance);
    const DifferentialMap map = differential_map(&chain->by, path->ray.direction, nearness);
    const vfloat by_path = chain->pdf * differential_density(&map, nearness, infinite) * cosine;
    const vfloat by_chain = chain_chooses(scene, light, over) * pdf * chain->chance * walk_kind_probability(scene, chain->kind);
    return over ? quotient(by_path, greater(by_path + by_chain, splat(1.0e-30f))) : splat(1.0f);
}

// Of a surface that shines.
static vfloat chains_leave_surface(const Scene* scene, const Path* path, const LightRow* light, const Surface* s, vmask where) {
    const vfloat pdf = inverse_or_one(light_area(light)), distance = magnitude(sub(s->point, path->ray.origin));
    return chains_leave(scene, path, s->light, pdf, absolute(inner(s->normal, path->ray.direction)), distance, mask_none(), where);
}

// Add the light that chains bring to the vertex.
static void chains_add(const Scene* scene, Path* path, const Vertex* v, PoolStats* stats) {
    const vmask asked = chains_begin(path, v) & v->traced;
    if (lane_any(asked)) path->radiance = add(path->radiance, inspect_chain(scene, path, choose(asked, walk_to_light(scene, path, v, asked, stats), vec3_all(0.0f))));
}

#else

static void chains_note(const Scene* scene, Path* path, const Vertex* v, const BsdfSample* next) {}
static vfloat chains_leave(const Scene* scene, const Path* path, vuint light, vfloat pdf, vfloat cosine, vfloat distance, vmask infinite, vmask where) {
    return splat(1.0f);
}
static vfloat chains_leave_surface(const Scene* scene, const Path* path, const LightRow* light, const Surface* s, vmask where) { return splat(1.0f); }
static void chains_add(const Scene* scene, Path* path, const Vertex* v, PoolStats* stats) {}

#endif

#endif
