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

// What is left of light that comes along a shadow ray.
static vec3 shadow_transmittance(const Scene* scene, const ShadowRay* shadow, vmask asked) {
    Ray ray = shadow->ray;
    Interior in = shadow->in;
    vec3 left = choose(asked, vec3_all(1.0f), vec3_all(0.0f));
    while (lane_any(asked)) {
        const Hit hit = traverse_nearest(&scene->bvh, &ray, asked);
        const vmask found = asked & (hit.primitive != NONE);
        const vfloat way = magnitude(ray.direction), distance = found ? hit.distance : shadow->infinite ? splat(FAR) : splat(1.0f);
        Surface surface = surface_at(scene, &ray, hit, found);
        const Crossing crossing = interior_meet(scene, &in, &surface, found);
        const vmask straight = interior_straight(&crossing), hidden = found & !straight;
        const vec3 direction = scale(ray.direction, inverse_or_one(way));
        const vec3 passes =
            interior_transmittance(scene, &in, ray.origin, direction, distance * way, shadow->infinite & !found, asked & !hidden);
        left = choose(asked, scale(mul(left, passes), passage_masked(scene, &ray, hit.distance, asked)), left);

        // Behind a surface that is no boundary it goes on
        left = choose(hidden, vec3_all(0.0f), left);
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

#endif

typedef struct {
    Passage passage;
#ifdef STRAIGHT_SHADOWS
    int pass;                // they do pass such surfaces,
    vec3 left[PACKETS];      // and this is left of the light on its way, by channel
#endif
} Shadows;

// Whether shadow rays pass surfaces that are no boundaries.
static int shadows_pass(const Scene* scene) {
#ifdef STRAIGHT_SHADOWS
    return scene_has(scene, HAS_STRAIGHT_SHADOWS);
#else
    return 0;
#endif
}

// The paths that go straight on, whose last vertex stays the one at which light samples and samples of the BSDF are weighed.
static vmask shadow_passes(const Scene* scene, vmask straight) { return shadows_pass(scene) ? straight : mask_none(); }

// What is left on the way, if that is free: all of it is in the medium that the ray begins in. Rays that pass surfaces tell themselves.
static vec3 shadow_straight(const Scene* scene, const Interior* in, const LightSample* light, vec3 from) {
    if (shadows_pass(scene)) return vec3_all(1.0f);
    const vfloat distance = magnitude(sub(light->target, from));
    return interior_transmittance(scene, in, from, light->direction, distance, light->infinite, light->pdf > 0.0f);
}

// Rays that pass surfaces go their whole way. Returns whether they do.
static int shadow_pass(const Scene* scene, Shadows* shadows, uint packet, const ShadowRay* shadow, vmask asked) {
#ifdef STRAIGHT_SHADOWS
    shadows->pass = shadows_pass(scene);
    if (shadows->pass) shadows->left[packet] = shadow_transmittance(scene, shadow, asked);
    return shadows->pass;
#else
    return 0;
#endif
}

// A packet's rays set out, those of every packet before they finish.
static void shadow_start(const Scene* scene, Shadows* shadows, uint packet, const ShadowRay* shadow, vmask asked) {
    if (shadow_pass(scene, shadows, packet, shadow, asked)) return;
    passage_start(scene, &shadows->passage, packet, &shadow->ray, asked);
}
static void shadow_finish(const Scene* scene, Shadows* shadows) {
    if (!shadows_pass(scene)) passage_finish(scene, &shadows->passage);
}

#ifdef OPACITY
// The same for rays of which it is known that nothing opaque stops them, if they do not pass surfaces.
static void shadow_start_masked(const Scene* scene, Shadows* shadows, uint packet, const ShadowRay* shadow, vmask asked) {
    if (!shadow_pass(scene, shadows, packet, shadow, asked)) passage_open(&shadows->passage, packet, &shadow->ray, asked);
}
static void shadow_finish_masked(const Scene* scene, Shadows* shadows) {
    if (!shadows_pass(scene)) passage_finish_masked(scene, &shadows->passage);
}
#endif

// Whether light arrives; less may than was sent.
static vmask shadow_arrives(const Shadows* shadows, uint packet, vec3* arriving) {
#ifdef STRAIGHT_SHADOWS
    if (shadows->pass) {
        *arriving = mul(*arriving, shadows->left[packet]);
        return largest(shadows->left[packet]) > 0.0f;
    }
#endif
    return passage_arrives(&shadows->passage, packet, arriving);
}

#endif
