// Photons in media (Jensen and Christensen, "Efficient simulation of light transport in scenes with participating media using photon maps", SIGGRAPH 1998):
// where a path scatters in a medium it gathers those within a ball that scattered in the same medium, by its phase function.
//
// Near the medium's surface, or another one, only a part of the ball is in the medium. Points of the ball, drawn until a ray from its centre reaches one,
// are in the mean as many as one over that part, as for the disks of surfaces (photon/disk.h). Panes of glass, and surfaces that are no boundary, are
// passed by the ray as they are by photons.
//
// Built only where media scatter (-D MEDIA).
#ifndef PHOTON_BALL_H
#define PHOTON_BALL_H

#include "core/sampler.h"
#include "core/warp.h"
#include "film/pool.h"
#include "geometry/find.h"
#include "geometry/surface.h"
#include "material/bsdf.h"
#include "material/interior.h"
#include "medium/homogeneous.h"
#include "medium/walk.h"
#include "photon/clear.h"

// The number of a medium as deposits have it; 0: it is of a surface.
#define BALL_FIRST_MEDIUM 1u

#ifdef MEDIA

#define BALL_MOST_TRIES 64u
#define BALL_SET 0x30000u        // of the sampler's sets of dimensions the first of these points

// Where photons are left and gathered: not below the surface of skin and the like, where paths walk on.
static vmask ball_receives(const Scene* scene, const Interior* in, const Bsdf* b, vmask dark) { return bsdf_in_medium(b) & !dark; }
static vuint ball_medium(const Interior* in) { return interior_top(in) + BALL_FIRST_MEDIUM; }

// Whether the end of a ray that something stands in the way of is in the same medium, behind nothing but what is clear.
static vmask ball_reaches(const Scene* scene, const Interior* own, Ray ray, Sampler sampler, vmask asked) {
    const vec3 way = ray.direction, end = add(ray.origin, way);
    Interior in = *own;
    vmask there = mask_none();
    for (uint n = 0; n < CLEAR_MOST_SURFACES && lane_any(asked); ++n) {
        const Hit hit = find_nearest(scene, &ray, sampler, splat_uint(n), mask_none(), asked);
        there = there | (asked & (hit.primitive == NONE) & (interior_top(&in) == interior_top(own)));
        asked = asked & (hit.primitive != NONE);
        Surface surface = surface_at(scene, &ray, hit, asked);
        const Crossing crossing = interior_meet(scene, &in, &surface, asked);
        asked = asked & (interior_straight(&crossing) | surface_is_clear(scene, &surface));
        interior_replace(&in, crossing.beyond, asked);
        Ray behind = surface_leave(&surface, way);
        behind.direction = sub(end, behind.origin);
        behind.limit = splat(1.0f);
        asked = asked & (inner(behind.direction, way) > 0.0f);
        ray_replace(&ray, behind, asked);
    }
    return there;
}

// One over the part of the ball that is in reach, in the mean; 0 where it is not asked for.
static vfloat ball_tries(const Scene* scene, const Interior* in, vec3 center, vfloat time, Sampler sampler, vuint set, float radius, vmask asked, PoolStats* stats) {
    vfloat tries = splat(0.0f);
    for (uint n = 0; n < BALL_MOST_TRIES && lane_any(asked); ++n) {
        vuint bits_u, bits_v, bits_w, unused;
        sampler_hash_bits(sampler, set + n, &bits_u, &bits_v);
        sampler_hash_bits(sampler, set + (n + BALL_MOST_TRIES), &bits_w, &unused);
        // The largest of three numbers is distributed as the distance of points of a ball
        const vfloat a = unit_interval(bits_w), b = unit_interval(unused), c = unit_interval(hash_pair(bits_w, unused));
        const vfloat distance = greater(greater(a, greater(b, c)), splat(1.0e-3f)) * radius;
        Ray ray = ray_in_time(ray_make(center, scale(warp_sphere(unit_interval(bits_u), unit_interval(bits_v)), distance)), time);
        ray.limit = splat(1.0f);
        tries = asked ? tries + 1.0f : tries;
        stats->shadow_rays += lane_count(asked);
        const vmask blocked = asked & (passage_of(scene, &ray, asked) <= 0.0f);   // what is masked counts where nothing gets through
        asked = blocked;
        stats->rays += lane_count(blocked);
        if (lane_any(blocked)) asked = asked & !ball_reaches(scene, in, ray, sampler, blocked);
    }
    return tries;
}

// The flux that a deposit has for gathering: in a grid over the density and the albedo there, so that what is gathered is the light and not how much
// of it is scattered.
static vec3 ball_flux(const Scene* scene, const Interior* in, vec3 point, vec3 flux, vmask where) {
#ifdef GRIDS
    vfloat row[16];
    interior_row(scene, where ? interior_top(in) : splat_uint(0u), row);
    vec3 albedo = vec3_all(1.0f), unused = albedo;
    grid_colors(scene, grid_head(row), point, where & grid_fills(row), &albedo, &unused);
    return scale(medium_per(flux, albedo), inverse_or_one(medium_density(scene, row, point, where)));
#else
    return flux;
#endif
}

#else

static vec3 ball_flux(const Scene* scene, const Interior* in, vec3 point, vec3 flux, vmask where) { return flux; }
static vmask ball_receives(const Scene* scene, const Interior* in, const Bsdf* b, vmask dark) { return mask_none(); }
static vuint ball_medium(const Interior* in) { return splat_uint(0u); }

#endif

#endif
