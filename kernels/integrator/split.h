// Paths that split: with several indirect rays, so many leave the first surface that is not a delta. Each carries its share of the
// throughput and has its own place in the sequence of random numbers; a path that ends goes back there for the next of them.
//
// Built only where it is asked for (-D PATH_SPLITS): with one indirect ray all of this is nothing.
#ifndef INTEGRATOR_SPLIT_H
#define INTEGRATOR_SPLIT_H

#include "core/sampler.h"
#include "geometry/ray.h"
#include "material/interior.h"
#include "types.h"

#ifdef PATH_SPLITS

typedef struct {
    vmask met;               // the path has met that surface
    vmask back;              // it is back there: light was added before
    vec3 origin, direction;  // of the ray that met it
    Hit hit;                 // there
    Interior interior;       // on its way there
    vec3 throughput;         // share of each ray
    vfloat index_squared;    // there
    Sampler sampler;
    vuint depth, left;       // rays that have still to leave
} Split;

static Split split_none(void) {
    Split s;
    s.met = s.back = mask_none();
    s.origin = s.direction = vec3_all(0.0f);
    s.interior = interior_none();
    s.throughput = vec3_all(0.0f);
    s.index_squared = splat(1.0f);
    s.sampler.seed = s.sampler.index = s.depth = s.left = splat_uint(0u);
    s.hit.distance = splat(0.0f);
    s.hit.primitive = splat_uint(NONE);
    return s;
}

// A new path begins.
static void split_start(Split* s, vmask lane) { s->met = s->met & !lane; }

// Where light was added before.
static vmask split_back(const Split* s) { return s->back; }

// Of the BSDF's samples, which the MIS weights count at the first such surface, those of this one.
static vfloat split_bsdf_samples(const Split* s, uint samples) { return s->met & !s->back ? splat((float)min(samples, 1u)) : splat((float)samples); }

// At a surface that is not a delta, before its BSDF is sampled: where it is the first, remember it. `hit`: what the ray met there. The ray is not
// traced again, so of it only the line is needed.
static void split_leave(Split* s, const Ray* ray, Hit hit, Interior interior, vec3* throughput, vfloat* index_squared, Sampler* sampler,
                        vuint depth, vmask samples_lights, uint rays) {
    const vmask opens = samples_lights & !s->met;
    if (lane_any(opens)) {
        s->origin = choose(opens, ray->origin, s->origin);
        s->direction = choose(opens, ray->direction, s->direction);
        interior_replace(&s->interior, interior, opens);
        s->throughput = choose(opens, scale(*throughput, quotient(splat(1.0f), splat((float)rays))), s->throughput);
        s->index_squared = opens ? *index_squared : s->index_squared;
        s->sampler.seed = opens ? sampler->seed : s->sampler.seed;
        s->sampler.index = opens ? sampler->index : s->sampler.index;
        s->depth = opens ? depth : s->depth;
        s->left = opens ? splat_uint(rays) : s->left;
        s->met = s->met | opens;
        s->hit.distance = opens ? hit.distance : s->hit.distance;
        s->hit.primitive = opens ? hit.primitive : s->hit.primitive;
    }
    // The next ray leaves, the first time or again
    const vmask leaves = opens | s->back;
    s->left = leaves ? s->left - 1u : s->left;
    const Sampler own = sampler_split(s->sampler, rays, rays - 1u - s->left);
    sampler->seed = leaves ? own.seed : sampler->seed;
    sampler->index = leaves ? own.index : sampler->index;
    *throughput = choose(leaves, s->throughput, *throughput);
    *index_squared = leaves ? s->index_squared : *index_squared;
}

// Paths that ended go back while rays are left there. Returns those that are at their end.
static vmask split_resume(Split* s, Ray* ray, Interior* interior, vuint* depth, vmask ended) {
    s->back = ended & s->met & (s->left > 0u);
    ray->origin = choose(s->back, s->origin, ray->origin);
    ray->direction = choose(s->back, s->direction, ray->direction);
    interior_replace(interior, s->interior, s->back);
    *depth = s->back ? s->depth : *depth;
    return ended & !s->back;
}

// What each ray carries that leaves where the path is.
static vec3 split_throughput(const Split* s, vec3 throughput) { return choose(s->back, s->throughput, throughput); }

// The random numbers that the path began with.
static Sampler split_first_sampler(const Split* s, Sampler sampler) {
    Sampler first;
    first.seed = s->met ? s->sampler.seed : sampler.seed;
    first.index = s->met ? s->sampler.index : sampler.index;
    return first;
}

// A path that is back there has met what it did.
static void split_again(const Split* s, Hit* hit) {
    hit->distance = s->back ? s->hit.distance : hit->distance;
    hit->primitive = s->back ? s->hit.primitive : hit->primitive;
}

#else

typedef struct {
    uint nothing;
} Split;

static Split split_none(void) {
    Split s;
    s.nothing = 0u;
    return s;
}
static void split_start(Split* s, vmask lane) {}
static vmask split_back(const Split* s) { return mask_none(); }
static vfloat split_bsdf_samples(const Split* s, uint samples) { return splat((float)samples); }
static void split_again(const Split* s, Hit* hit) {}
static vec3 split_throughput(const Split* s, vec3 throughput) { return throughput; }
static Sampler split_first_sampler(const Split* s, Sampler sampler) { return sampler; }
static void split_leave(Split* s, const Ray* ray, Hit hit, Interior interior, vec3* throughput, vfloat* index_squared, Sampler* sampler,
                        vuint depth, vmask samples_lights, uint rays) {}
static vmask split_resume(Split* s, Ray* ray, Interior* interior, vuint* depth, vmask ended) { return ended; }

#endif

#endif
