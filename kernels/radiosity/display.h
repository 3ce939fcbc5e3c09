// Radiosity made visible: what a camera ray meets is looked up.
#ifndef RADIOSITY_DISPLAY_H
#define RADIOSITY_DISPLAY_H

#include "camera/camera.h"
#include "film/pool.h"
#include "geometry/surface.h"
#include "material/bsdf.h"
#include "radiosity/patch.h"

// `looks` has a row for each side, and at the end one for what lies outside: LOOK_ROW_* of types.h, radiance W/(sr m²); of a textured
// side that of a white one.

static vec3 display_interpolated(const Scene* scene, const Surface* s, const vfloat look[16]) {
    vfloat row[16], b, c;
    lane_rows(scene->primitive_rows, s->primitive, row);
    surface_weights(s, row, &b, &c);
    const vfloat weight_b = bounded(b, 0.0f, 1.0f), weight_c = lesser(greater(c, splat(0.0f)), splat(1.0f) - weight_b);
    const vfloat weight_a = splat(1.0f) - weight_b - weight_c;
    return surface_blend(look, weight_a, weight_b, weight_c);
}

static void display_trace(const Scene* scene, Pool* pool, PoolStats* stats, __global const float* looks) {
    __global const Settings* settings = scene->settings;
    while (!pool_empty(pool)) {
        PoolSample sample;
        vfloat film_x, film_y, look[16];
        const vmask start = pool_take(settings, pool, &sample, &film_x, &film_y);
        if (!lane_any(start)) continue;
        const Ray ray = camera_ray(scene, 0u, film_x, film_y, sample.sampler, splat(0.0f));
        const Hit hit = traverse_nearest(&scene->bvh, &ray, start);
        stats->rays += lane_count(start);
        const vmask found = start & (hit.primitive != NONE);
        const Surface s = surface_at(scene, &ray, hit, found);
        lane_rows(looks, found ? s.primitive * 2u + (s.front ? splat_uint(0u) : splat_uint(1u)) : patch_outside(scene), look);
        const vec3 own = vec3_row(look, LOOK_ROW_OWN);
        vec3 reflected = display_interpolated(scene, &s, look);
#ifdef TEXTURES
        Bsdf bsdf;
        bsdf_at(scene, &s, ray.direction, &bsdf);
        reflected = choose(s.attributes.textured, mul(reflected, bsdf.color), reflected);
#endif
        const vec3 seen = add(own, choose(found, reflected, vec3_all(0.0f)));
        pool_deliver(pool, &sample, choose(camera_sees(&ray), seen, vec3_all(0.0f)), start);
        stats->deepest = pool_deepest(stats->deepest, splat_uint(0u), found);
    }
}

#endif
