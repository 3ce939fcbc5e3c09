// How much of the disk around a point is surface: at edges and corners photons can be on a part of it only.
//
// Photons within the disk's radius count where they are at most a little above or below its plane, each with the cosine between the two
// normals: that makes their flux a density over the disk. Points of the disk, drawn until one has such a surface below it, are in the
// mean as many as one over the share of the disk that has (a geometric distribution), and independent of the photons; so flux times
// that number, over the disk's area, has the mean of the irradiance on that share as its own mean. (The reciprocal of a probability by
// counting: Booth 2007; for photons, Qin et al., "Unbiased photon gathering for light transport simulation", ACM TOG 34(6) 2015.)
#ifndef PHOTON_DISK_H
#define PHOTON_DISK_H

#include "core/sampler.h"
#include "core/warp.h"
#include "film/pool.h"
#include "geometry/find.h"
#include "geometry/surface.h"
#include "light/light.h"
#include "photon/clear.h"
#include "types.h"

// Of a photon within the radius at most this far above or below the tangent plane, in radii: around a corner lies another surface.
#define DISK_OFF_PLANE 0.25f
static float disk_off_plane(float radius) { return radius * DISK_OFF_PLANE; }
// A photon does not count where it lies behind the point's tangent plane and the point before the photon's: then it is on another sheet,
// which faces the back of the point's own. On one surface both are behind each other's planes, as on a ball, or both before them, as in a
// corner. So far either may seem to be by rounding.
static vfloat disk_flat(const Surface* surface, vec3 side, float radius) {
    return fma(surface->clearance, splat(4.0f), splat(radius * 16.0f * EPSILON));
}
// Slivers of surface may need more points than that: then it looks a little darker.
#define DISK_MOST_TRIES 64u
#define DISK_SET 0x10000u        // of the sampler's sets of dimensions the first of these points

// Whether photons count on a surface at all: nothing is seen of those on a black one, and such are the lamps.
static vmask disk_receives(const Surface* s) { return (s->kind == MATERIAL_LAMBERT) & (largest(s->color) > 0.0f); }

// Whether what lies below a point of the disk is not where photons of the disk arrive. Where the ray up from there meets the back of a surface that is
// opaque, it is inside of something. Where its other side is up than at the disk's centre, it is that only if it sees the centre.
static vmask disk_hides(const Scene* scene, const Surface* below, vec3 centre, vec3 side, vmask other_side, Sampler sampler, vmask asked) {
    Ray ray = surface_leave(below, side);
    ray.direction = choose(other_side, sub(centre, ray.origin), side);
    ray.limit = other_side ? splat(1.0f) : ray.limit;
    const Hit hit = find_nearest(scene, &ray, sampler, splat_uint(0u), mask_none(), asked);
    const vmask found = asked & (hit.primitive != NONE);
    const Surface s = surface_at(scene, &ray, hit, found);
    const vmask back = found & !s.front & !other_side;
    return (found & other_side) | (lane_any(back) ? back & !surface_is_clear(scene, &s) : back);
}

// Whether a photon could be below the point `to` away from the disk's centre. From above the centre a ray goes to above that point,
// and from there down through all that lies there: a glass ball and one of steel touch the floor in a point, and around it photons arrive between
// them. What lies inside of something closed and opaque that stands on the surface is not reached: the first ray meets that from outside, and above
// the point is its inside. `sampler`: of where surfaces with holes are.
static vmask disk_has_surface(const Scene* scene, const Surface* surface, vec3 side, vec3 to, float radius, Sampler sampler, vmask asked,
                              PoolStats* stats) {
    const float off = disk_off_plane(radius);
    const vec3 centre = surface_leave(surface, side).origin;
    Ray ray = ray_in_time(ray_make(along(centre, side, splat(off)), to), surface_time(surface));
    ray.limit = splat(1.0f);
    const vmask blocked = passage_of(scene, &ray, asked) <= 0.0f;
    stats->shadow_rays += lane_count(asked);
    ray.origin = add(ray.origin, to);
    ray.direction = negate(side);
    ray.limit = splat(2.0f * off);
    const vfloat flat = disk_flat(surface, side, radius);
    vmask found = mask_none();
    for (uint n = 0; n < CLEAR_MOST_SURFACES && lane_any(asked); ++n) {
        stats->rays += lane_count(asked);
        const Hit hit = find_nearest(scene, &ray, sampler, splat_uint(n), mask_none(), asked);
        asked = asked & (hit.primitive != NONE);
        const Surface below = surface_at(scene, &ray, hit, asked);
        const vec3 away = sub(below.point, surface->point);
        const vec3 below_side = choose(below.front, below.normal, negate(below.normal));
        const vmask behind = (inner(away, side) < -flat) & (inner(away, below_side) < -flat);
        vmask here = asked & disk_receives(&below) & (inner(away, away) <= radius * radius) & !behind;
        const vmask other_side = below.front ? !surface->front : surface->front;
        const vmask unsure = here & (blocked | other_side | (n > 0u ? mask_all() : mask_none()));
        stats->rays += lane_count(unsure);
        if (lane_any(unsure)) here = here & !disk_hides(scene, &below, centre, side, other_side, sampler, unsure);
        found = found | here;

        // Go on behind it
        Ray behind_it = surface_leave(&below, ray.direction);
        behind_it.limit = inner(sub(behind_it.origin, surface->point), side) + off;
        asked = asked & !here & (behind_it.limit > 0.0f);
        ray_replace(&ray, behind_it, asked);
    }
    return found;
}

// One over the share of the disk that is surface, in the mean; 0 where it is not asked for. `set`: of random numbers.
#ifdef HOLES
__attribute__((noinline))   // rays through holes take more registers than what a GPU has beside the rest
#endif
static vfloat disk_tries(const Scene* scene, const Surface* surface, vec3 side, Sampler sampler, vuint set, float radius, vmask asked,
                         PoolStats* stats) {
    const Frame frame = frame_around(side);
    vfloat tries = splat(0.0f);
    for (uint n = 0; n < DISK_MOST_TRIES && lane_any(asked); ++n) {
        vuint bits_u, bits_v;
        sampler_hash_bits(sampler, set + n, &bits_u, &bits_v);
        vfloat x, y;
        warp_disk(unit_interval(bits_u), unit_interval(bits_v), &x, &y);
        x = (x == 0.0f) & (y == 0.0f) ? splat(1.0e-3f) : x;
        const vec3 to = add(scale(frame.tangent, x * radius), scale(frame.bitangent, y * radius));
        tries = asked ? tries + 1.0f : tries;
        Sampler own = sampler;
        own.seed ^= hash_pair(splat_uint(set + n), splat_uint(DISK_SET));
        asked = asked & !disk_has_surface(scene, surface, side, to, radius, own, asked, stats);
    }
    return tries;
}

#endif
