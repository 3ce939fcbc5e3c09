// Radiosity made visible: what a camera ray meets is looked up, or gathered once more from all that it sees.
#ifndef RADIOSITY_DISPLAY_H
#define RADIOSITY_DISPLAY_H

#include "camera/perspective.h"
#include "film/pool.h"
#include "radiosity/direct.h"
#include "radiosity/patch.h"

// Sixteen numbers for each side, and at the end for what lies outside, radiance W/(sr m²): reflected at the corners A, B, C; sent out
// by itself; the mean of what is reflected; and 1 where a gathering ray has to count what it sends out, because no light does.
#define DISPLAY_GATHER 1u

static vec3 display_interpolated(const Scene* scene, const Surface* s, const vfloat look[16]) {
    vfloat row[16];
    lane_rows(scene->primitive_rows, s->primitive, row);
    const vec3 a = vec3_of(row[0], row[1], row[2]);
    const vec3 ab = sub(vec3_of(row[3], row[4], row[5]), a), ac = sub(vec3_of(row[6], row[7], row[8]), a), ap = sub(s->point, a);
    const vec3 normal = outer(ab, ac), scaled = scale(normal, inverse_scale(normal));
    const vfloat inverse = inverse_or_one(inner(normal, scaled));
    const vfloat weight_b = bounded(inner(outer(ap, ac), scaled) * inverse, 0.0f, 1.0f);
    const vfloat weight_c = lesser(greater(inner(outer(ab, ap), scaled) * inverse, splat(0.0f)), splat(1.0f) - weight_b);
    const vfloat weight_a = splat(1.0f) - weight_b - weight_c;
    return vec3_of(fma(weight_a, look[0], fma(weight_b, look[3], weight_c * look[6])),
                   fma(weight_a, look[1], fma(weight_b, look[4], weight_c * look[7])),
                   fma(weight_a, look[2], fma(weight_b, look[5], weight_c * look[8])));
}

// Final gather (Reichert 1992): direct light, and one more bounce to the patches.
static vec3 display_gathered(const Scene* scene, const Surface* s, Sampler sampler, __global const float* looks, vmask found,
                             PoolStats* stats) {
    vuint bits_u, bits_v;
    vec3 arriving = vec3_all(0.0f);
    const vec3 normal = choose(s->front, s->normal, negate(s->normal));
    if (scene->settings->light_count > 0) {
        sampler_bits(sampler, splat_uint(SET_LIGHT), &bits_u, &bits_v);
        const DirectSample direct = direct_sample(scene, s, normal, bits_u, bits_v);
        const vmask asked = found & (largest(direct.irradiance) > 0.0f);
        const vmask blocked = traverse_occluded(&scene->bvh, &direct.ray, asked);
        arriving = choose(asked & !blocked, scale(direct.irradiance, splat(INV_PI)), arriving);
        stats->shadow_rays += lane_count(asked);
    }
    vfloat u, v, look[16];
    sampler_get(sampler, SET_MATERIAL, &u, &v);
    const Ray ray = surface_leave(s, direction_again(frame_to_world(frame_around(normal), warp_cosine_hemisphere(u, v))));
    const Hit hit = traverse_nearest(&scene->bvh, &ray, found);
    stats->rays += lane_count(found);
    lane_rows(looks, patch_met(scene, &ray, hit), look);
    const vec3 sent = along(vec3_of(look[12], look[13], look[14]), vec3_of(look[9], look[10], look[11]), look[15]);
    return mul(s->color, add(arriving, sent));
}

static void display_trace(const Scene* scene, Pool* pool, PoolStats* stats, __global const float* looks, uint mode) {
    __global const Settings* settings = scene->settings;
    PoolSample sample = pool_no_sample();
    const vmask idle = sample.slot == sample.slot;
    while (!pool_empty(pool)) {
        const vmask start = pool_take(settings, pool, idle, &sample);
        if (!lane_any(start)) continue;
        vfloat film_x, film_y, look[16];
        pool_film(settings, &sample, &film_x, &film_y);
        const Ray ray = perspective_ray(scene, film_x, film_y, sample.sampler);
        const Hit hit = traverse_nearest(&scene->bvh, &ray, start);
        stats->rays += lane_count(start);
        const vmask found = start & (hit.primitive != NONE);
        const Surface s = surface_at(scene, &ray, hit, found);
        lane_rows(looks, found ? s.primitive * 2u + (s.front ? splat_uint(0u) : splat_uint(1u)) : patch_outside(scene), look);
        const vec3 own = vec3_of(look[9], look[10], look[11]);
        vec3 reflected = display_interpolated(scene, &s, look);
        if (mode == DISPLAY_GATHER) reflected = display_gathered(scene, &s, sample.sampler, looks, found, stats);
        pool_deliver(pool, &sample, add(own, choose(found, reflected, vec3_all(0.0f))), start);
        stats->deepest = pool_deepest(stats->deepest, splat_uint(mode == DISPLAY_GATHER ? 1u : 0u), found);
    }
}

#endif
