// Shadow rays: what of the light samples arrives.
//
// Mostly a ray only has to be free. But there are surfaces that are no boundaries: the edge of a cloud, or of glass in a liquid of the same
// index. Light goes straight on there, so where a scene has such surfaces (-D STRAIGHT_SHADOWS) a shadow ray looks behind them; and light that a
// path finds behind them could have been sampled at the last vertex.
#ifndef INTEGRATOR_SHADOW_H
#define INTEGRATOR_SHADOW_H

#include "geometry/find.h"
#include "geometry/surface.h"
#include "light/light.h"
#include "material/interior.h"

// A ray to a point of a light.
typedef struct {
    Ray ray;
#ifdef STRAIGHT_SHADOWS
    vec3 target;             // where it ends; a direction when `infinite`
    vmask infinite;
    Interior in;             // the media that it begins in
#endif
} ShadowRay;

static ShadowRay shadow_none(void) {
    ShadowRay s;
    s.ray = ray_make(vec3_all(0.0f), vec3_all(1.0f));
#ifdef STRAIGHT_SHADOWS
    s.target = vec3_all(0.0f);
    s.infinite = mask_none();
    s.in = interior_none();
#endif
    return s;
}

static ShadowRay shadow_ray(const Surface* surface, const LightSample* light, const Interior* in) {
    ShadowRay s;
    s.ray = light_shadow_ray(surface, light);
#ifdef STRAIGHT_SHADOWS
    s.target = light->target;
    s.infinite = light->infinite;
    s.in = *in;
#endif
    return s;
}

#ifdef STRAIGHT_SHADOWS

typedef struct {
    vec3 left[PACKETS];      // of the light on its way, by channel
} Shadows;

// The paths that go straight on, whose last vertex stays the one at which light samples and samples of the BSDF are weighed.
static vmask shadow_passes(vmask straight) { return straight; }

// What is left on the way: the rays themselves tell.
static vec3 shadow_straight(const Scene* scene, const Interior* in, const LightSample* light, vec3 from) { return vec3_all(1.0f); }

// What is left of light that comes along a shadow ray.
static vec3 shadow_transmittance(const Scene* scene, const ShadowRay* shadow, vmask asked) {
    Ray ray = shadow->ray;
    Interior in = shadow->in;
    vec3 left = choose(asked, vec3_all(1.0f), vec3_all(0.0f));
    while (lane_any(asked)) {
        const Hit hit = traverse_nearest(&scene->bvh, &ray, asked);
        const vmask found = asked & (hit.primitive != NONE);
        const vfloat way = magnitude(ray.direction), distance = found ? hit.distance : shadow->infinite ? splat(FAR) : splat(1.0f);
        const vec3 passes = interior_transmittance(scene, &in, distance * way, shadow->infinite & !found);
        left = choose(asked, scale(mul(left, passes), passage_masked(scene, &ray, hit.distance, asked)), left);

        // Behind a surface that is no boundary it goes on
        Surface surface = surface_at(scene, &ray, hit, found);
        const Crossing crossing = interior_meet(scene, &in, &surface, found);
        const vmask straight = interior_straight(&crossing);
        left = choose(found & !straight, vec3_all(0.0f), left);
        asked = straight & (largest(left) > 0.0f);
        interior_replace(&in, crossing.beyond, asked);
        Ray behind = surface_leave(&surface, ray.direction);
        behind.direction = choose(shadow->infinite, shadow->target, sub(shadow->target, behind.origin));
        behind.limit = ray.limit;
        behind.to = ray.to;
        ray_replace(&ray, behind, asked);
    }
    return left;
}

static void shadow_start(const Scene* scene, Shadows* shadows, uint packet, const ShadowRay* shadow, vmask asked) {
    shadows->left[packet] = shadow_transmittance(scene, shadow, asked);
}
static void shadow_finish(const Scene* scene, Shadows* shadows) {}

// Whether light arrives; less may than was sent.
static vmask shadow_arrives(const Shadows* shadows, uint packet, vec3* arriving) {
    *arriving = mul(*arriving, shadows->left[packet]);
    return largest(shadows->left[packet]) > 0.0f;
}

#else

typedef Passage Shadows;

static vmask shadow_passes(vmask straight) { return mask_none(); }

// What is left on the way, if that is free: all of it is in the medium that the ray begins in.
static vec3 shadow_straight(const Scene* scene, const Interior* in, const LightSample* light, vec3 from) {
    return interior_transmittance(scene, in, magnitude(sub(light->target, from)), light->infinite);
}
static void shadow_start(const Scene* scene, Shadows* shadows, uint packet, const ShadowRay* shadow, vmask asked) {
    passage_start(scene, shadows, packet, &shadow->ray, asked);
}
static void shadow_finish(const Scene* scene, Shadows* shadows) { passage_finish(scene, shadows); }
static vmask shadow_arrives(const Shadows* shadows, uint packet, vec3* arriving) { return passage_arrives(shadows, packet, arriving); }

#endif

#endif
