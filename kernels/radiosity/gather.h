// Final gather (Reichert 1992) over three bounces: a path of the path tracer to its fourth surface, and there, in place of the rest of the
// path, what the patches know of light that has been reflected before. Direct light is sampled at every surface, so that what patches are
// too coarse for, shadows and the surroundings of lights, does not depend on them. The scene is the one before it was cut into patches.
#ifndef RADIOSITY_GATHER_H
#define RADIOSITY_GATHER_H

#include "camera/camera.h"
#include "film/pool.h"
#include "geometry/surface.h"
#include "light/light.h"
#include "material/bsdf.h"

#define GATHER_BOUNCES 3u

// Of a primitive, or of what lies outside: radiance that its front sends out; 1 where a gathering ray has to count it, because no shadow
// ray looks for it; its first texel and how many there are along an edge. Texels are squares of radiance, front and back.
typedef struct {
    __global const float* rows;
    __global const float* texels;
} Atlas;

typedef struct {
    vec3 own;
    vfloat counted;
    vuint first, along;
} AtlasRow;

static AtlasRow gather_row(const Scene* scene, const Atlas* atlas, vuint primitive, vmask found) {
    vfloat row[16];
    lane_rows(atlas->rows, found ? primitive : splat_uint(scene->settings->primitive_count), row);
    AtlasRow r;
    r.own = vec3_row(row, ATLAS_ROW_OWN);
    r.counted = row[ATLAS_ROW_COUNTED];
    r.first = vfloat_bits(row[ATLAS_ROW_FIRST]);
    r.along = vfloat_bits(row[ATLAS_ROW_ALONG]);
    return r;
}

// Where a point is on its primitive, both numbers about in [0, 1]: as clrender/radiosity/atlas.py.
static void gather_place(const Scene* scene, const Surface* s, vfloat* x, vfloat* y) {
    vfloat row[16];
    lane_rows(scene->primitive_rows, s->primitive, row);
    surface_weights(s, row, x, y);
    const vmask is_round = s->primitive >= scene->settings->triangle_count;
    if (!lane_any(is_round)) return;
    // Spheres: the octahedron about the centre, unfolded. Disks: the two axes that the normal is least along.
    const vec3 to = sub(s->point, vec3_row(row, PRIMITIVE_ROW_CENTER)), normal = vec3_row(row, PRIMITIVE_ROW_NORMAL);
    const vfloat nx = absolute(normal.x), ny = absolute(normal.y), nz = absolute(normal.z);
    const vmask disk = (nx != 0.0f) | (ny != 0.0f) | (nz != 0.0f), drop_z = (nz >= nx) & (nz >= ny), drop_y = !drop_z & (ny >= nx);
    const vfloat size = disk ? row[PRIMITIVE_ROW_RADIUS] : absolute(to.x) + absolute(to.y) + absolute(to.z);
    const vec3 at = scale(to, inverse_or_one(size));
    const vmask low = !disk & (at.z < 0.0f);
    const vfloat u = low ? with_sign(splat(1.0f) - absolute(at.y), at.x) : ((!disk | drop_z | drop_y) ? at.x : at.y);
    const vfloat v = low ? with_sign(splat(1.0f) - absolute(at.x), at.y) : ((!disk | drop_z) ? at.y : at.z);
    *x = is_round ? fma(u, splat(0.5f), splat(0.5f)) : *x;
    *y = is_round ? fma(v, splat(0.5f), splat(0.5f)) : *y;
}

static vuint gather_texel_along(vfloat x, vuint along) {
    const vfloat count = vfloat_of(vint_from_uint(along));
    const vfloat at = lesser(greater(x, splat(0.0f)) * count, count - 1.0f);
    return vuint_of(at);
}

// Radiance that patches reflect, from a point of one side, of light that has been reflected before. Texels hold it as of a white surface
// where there is a texture, which has more detail than patches.
static vec3 gather_indirect(const Scene* scene, const Atlas* atlas, const Surface* s, const Bsdf* bsdf, const AtlasRow* row) {
    vfloat x, y;
    gather_place(scene, s, &x, &y);
    const vuint back = s->front ? splat_uint(0u) : splat_uint(1u);
    const vuint line = back * row->along + gather_texel_along(y, row->along);
    const vuint texel = (row->first + line * row->along + gather_texel_along(x, row->along)) * 3u;
    const vec3 sent = vec3_of(lane_gather(atlas->texels, texel), lane_gather(atlas->texels, texel + 1u), lane_gather(atlas->texels, texel + 2u));
#ifdef TEXTURES
    return choose(s->attributes.textured, mul(sent, bsdf->color), sent);
#else
    return sent;
#endif
}

// Radiance that leaves a surface of light straight from a light, sampled.
static vec3 gather_direct(const Scene* scene, const Surface* s, const Bsdf* bsdf, Sampler sampler, uint bounce, vmask where,
                          PoolStats* stats) {
    const vec3 none = vec3_all(0.0f);
    if (scene->settings->light_count == 0) return none;
    vfloat unused;
    const vuint set = sampler_set(splat_uint(bounce), SET_LIGHT);
    const LightSample light = light_sample(scene, s->point, bsdf_receives(bsdf), s->primitive, sampler, set);
    const vec3 f = bsdf_eval(bsdf, light.direction, &unused);
    const vec3 direct = choose(light.pdf > 0.0f, scale(mul(f, light.radiance), inverse_or_one(light.pdf)), none);
    const vmask asked = where & (largest(direct) > 0.0f);
    const Ray ray = light_shadow_ray(s, &light);
    const vmask blocked = traverse_occluded(&scene->bvh, &ray, asked);
    stats->shadow_rays += lane_count(asked);
    return choose(asked & !blocked, direct, none);
}

static void gather_trace(const Scene* scene, const Atlas* atlas, Pool* pool, PoolStats* stats) {
    __global const Settings* settings = scene->settings;
    while (!pool_empty(pool)) {
        PoolSample sample;
        vfloat film_x, film_y;
        const vmask start = pool_take(settings, pool, &sample, &film_x, &film_y);
        if (!lane_any(start)) continue;
        Ray ray = camera_ray(scene, 0u, film_x, film_y, sample.sampler, splat(0.0f));
        vec3 radiance = vec3_all(0.0f), throughput = choose(camera_sees(&ray), vec3_all(1.0f), vec3_all(0.0f));
        vmask alive = start;
        for (uint bounce = 0; bounce <= GATHER_BOUNCES; ++bounce) {
            const Hit hit = traverse_nearest(&scene->bvh, &ray, alive);
            const vmask found = alive & (hit.primitive != NONE);
            const Surface s = surface_at(scene, &ray, hit, found);
            const AtlasRow row = gather_row(scene, atlas, s.primitive, found);
            Bsdf bsdf;
            bsdf_at(scene, &s, ray.direction, &bsdf);
            stats->rays += lane_count(alive);
            vec3 sent = gather_direct(scene, &s, &bsdf, sample.sampler, bounce, found, stats);
            if (bounce == GATHER_BOUNCES) sent = choose(found, add(sent, gather_indirect(scene, atlas, &s, &bsdf, &row)), sent);
            const vmask counts = splat(bounce == 0u ? 1.0f : 0.0f) + row.counted > 0.0f, shows = alive & (!found | s.front) & counts;
            sent = choose(shows, add(sent, row.own), sent);
            radiance = choose(alive, add(radiance, mul(throughput, sent)), radiance);
            stats->deepest = pool_deepest(stats->deepest, splat_uint(bounce), alive);
            vuint bits_u, bits_v;
            sampler_bits(sample.sampler, sampler_set(splat_uint(bounce), SET_BSDF), &bits_u, &bits_v);
            const BsdfSample next = bsdf_sample(&bsdf, bits_u, bits_v);
            throughput = mul(throughput, next.weight);
            ray = surface_leave(&s, next.direction);
            alive = found & (largest(throughput) > 0.0f);
        }
        pool_deliver(pool, &sample, radiance, start);
    }
}

#endif
