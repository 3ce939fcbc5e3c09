// Patches are the scene's triangles. Each has two sides, numbered 2 i (front) and 2 i + 1 (back); 2 × primitive_count is what lies
// outside of the scene.
#ifndef RADIOSITY_PATCH_H
#define RADIOSITY_PATCH_H

#include "core/sampler.h"
#include "core/warp.h"
#include "geometry/surface.h"
#include "scene.h"

// A point of a side, from two numbers in [0, 1), uniform by area; the normal is the side's own.
static Surface patch_point(const Scene* scene, vuint side, vfloat u, vfloat v) {
    vfloat row[16], weight_b, weight_c;
    Surface s;
    s.primitive = side >> 1;
    lane_rows(scene->primitive_rows, s.primitive, row);
    const vec3 a = vec3_row(row, PRIMITIVE_ROW_A), ab = sub(vec3_row(row, PRIMITIVE_ROW_B), a), ac = sub(vec3_row(row, PRIMITIVE_ROW_C), a);
    warp_triangle(u, v, &weight_b, &weight_c);
    s.point = add(a, add(scale(ab, weight_b), scale(ac, weight_c)));
    s.error = scale(vec3_of(absolute(a.x) + absolute(ab.x) + absolute(ac.x), absolute(a.y) + absolute(ab.y) + absolute(ac.y),
                            absolute(a.z) + absolute(ab.z) + absolute(ac.z)),
                    splat(16.0f * EPSILON));
    const vec3 normal = unit(outer(ab, ac));
    s.normal = choose((side & 1u) != 0u, negate(normal), normal);
    s.clearance = ray_clearance(s.normal, s.error);
    s.shading = s.normal;
    s.front = mask_all();
    s.from = s.primitive;
    s.light = vfloat_bits(row[PRIMITIVE_ROW_LIGHT]);
    s.color = vec3_row(row, PRIMITIVE_ROW_COLOR);
    s.termination = row[PRIMITIVE_ROW_TERMINATION];
    s.ior = row[PRIMITIVE_ROW_IOR];
    s.kind = splat_uint(MATERIAL_LAMBERT);
    return s;
}

// Ray number `index` of a side: from anywhere on it, each direction as likely as its cosine. The share of such rays that meet
// another side is the form factor (Cohen & Wallace 1993, 4.3.2).
static Ray patch_ray(const Scene* scene, uint seed, vuint side, vuint index) {
    const Sampler sampler = sampler_start(seed, side, index);
    vfloat u, v;
    sampler_get(sampler, SET_PIXEL, &u, &v);
    const Surface s = patch_point(scene, side, u, v);
    sampler_get(sampler, SET_BSDF, &u, &v);
    return surface_leave(&s, direction_again(frame_to_world(frame_around(s.normal), warp_cosine_hemisphere(u, v))));
}

static vuint patch_outside(const Scene* scene) { return splat_uint(scene->settings->primitive_count * 2u); }

// The side that a ray met.
static vuint patch_met(const Scene* scene, const Ray* ray, Hit hit) {
    const vmask found = hit.primitive != NONE;
    const vuint primitive = found ? hit.primitive : splat_uint(0u);
    vfloat row[16];
    lane_rows(scene->primitive_rows, primitive, row);
    const vec3 a = vec3_row(row, PRIMITIVE_ROW_A);
    const vec3 normal = outer(sub(vec3_row(row, PRIMITIVE_ROW_B), a), sub(vec3_row(row, PRIMITIVE_ROW_C), a));
    // Scaled first, so that the sign of a small patch's product is not lost
    const vmask back = inner(scale(normal, inverse_scale(normal)), ray->direction) > 0.0f;
    const vuint side = primitive * 2u + (back ? splat_uint(1u) : splat_uint(0u));
    return found ? side : patch_outside(scene);
}

#endif
