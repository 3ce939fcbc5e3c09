// A specular chain: the way of a ray over one or two deltas.
#ifndef SPECULAR_CHAIN_H
#define SPECULAR_CHAIN_H

#include "film/pool.h"
#include "geometry/find.h"
#include "integrator/path_state.h"
#include "integrator/vertex.h"
#include "specular/delta.h"
#include "specular/differential.h"

typedef struct {
    vmask valid;             // there is one
    vec3 weight;             // of its deltas
    vec3 media;              // what media leave on the way. In grids that is a random estimate, and as such no part of whether there is a chain
    vfloat chosen;           // probability that a path chooses the same at its vertices
    Surface last;            // its last vertex, as far as a ray that leaves it needs
    Interior in;             // the media that this ray begins in
    vec3 direction;          // of it, unit
    Differential by;         // of it
} Chain;

// Follow the ray that leaves the vertex in a direction, over deltas where what happens is as `kind` says.
static void chain_follow(const Scene* scene, const Path* path, const Vertex* v, vuint kind, vec3 direction, vmask asked, Chain* c, PoolStats* stats) {
    Ray ray = surface_leave(&v->surface, direction);
    c->valid = asked;
    c->weight = c->media = vec3_all(1.0f);
    c->chosen = splat(1.0f);
    c->last = v->surface;
    c->in = interior_towards(&path->interior, &v->crossing, direction, v->bsdf.side);
    c->direction = direction;
    c->by = differential_begin(direction);
    vuint made = splat_uint(0u);
    vmask open = asked;
    while (lane_any(open)) {
        const vuint depth = path->depth + 1u + made;
        const Hit hit = find_nearest(scene, &ray, path->sample.sampler, depth, mask_none(), open);
        stats->rays += lane_count(open);
        stats->deepest = pool_deepest(stats->deepest, depth, open);
        const vmask found = open & (hit.primitive != NONE);
        Surface s = surface_at(scene, &ray, hit, found);
        surface_random(&s, path->sample.sampler, depth);
        const vec3 left = interior_transmittance(scene, &c->in, ray.origin, ray.direction, hit.distance, mask_none(), found);
        const Crossing crossing = interior_meet(scene, &c->in, &s, found);
        Bsdf bsdf;
        bsdf_at(scene, &s, ray.direction, &bsdf);
        const vmask straight = found & interior_straight(&crossing), meets = found & !straight & delta_in_chain(&s, &bsdf, ray.direction);
        const vmask through = chain_kind_through(kind, made);
        vfloat chosen;
        const BsdfSample next = delta_follow(&bsdf, through, &chosen);
        differential_advance(&c->by, hit.distance, straight);
        differential_meet(scene, &c->by, &s, &bsdf, ray.direction, hit.distance, through, meets);
        c->media = choose(found, mul(c->media, left), c->media);
        c->weight = choose(meets, mul(c->weight, next.weight), c->weight);
        c->chosen = meets ? c->chosen * chosen : c->chosen;
        c->valid = c->valid & (meets | straight | !open) & (largest(c->weight) > 0.0f);

        const vec3 onwards = choose(straight, ray.direction, next.direction);
        interior_replace(&c->in, interior_towards(&c->in, &crossing, onwards, bsdf.side), meets | straight);
        c->direction = choose(meets, onwards, c->direction);
        c->last.point = choose(meets, s.point, c->last.point);
        c->last.normal = choose(meets, s.normal, c->last.normal);
        c->last.clearance = meets ? s.clearance : c->last.clearance;
        c->last.from = meets ? s.from : c->last.from;
        made = meets ? made + 1u : made;
        open = open & c->valid & (made < chain_kind_count(kind));
        ray_replace(&ray, surface_leave(&s, onwards), open);
    }
}

#endif
