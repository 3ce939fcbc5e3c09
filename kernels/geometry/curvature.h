// How the shading normal of a surface changes where its point moves: what the differential of a specular path needs (Igehy, "Tracing ray
// differentials", SIGGRAPH 1999).
#ifndef GEOMETRY_CURVATURE_H
#define GEOMETRY_CURVATURE_H

#include "geometry/surface.h"

// The rows of a surface that are read once for several steps.
typedef struct {
    Placed placed;
    vfloat row[16];
    vfloat normals[16];
    vmask sphere, smooth;
} Curvature;

static Curvature curvature_at(const Scene* scene, const Surface* s, vmask where) {
    Curvature c;
    c.placed = placed_at(scene, where ? s->primitive : splat_uint(0u), surface_time(s));
    lane_rows(scene->primitive_rows, c.placed.row, c.row);
    const vuint flags = vfloat_bits(c.row[PRIMITIVE_ROW_KIND]) >> ROW_FLAGS;
    const vmask round = c.placed.row >= scene->settings->triangle_count;
    placed_geometry(&c.placed, round, c.row);
    const vec3 disk = vec3_row(c.row, PRIMITIVE_ROW_NORMAL);
    c.sphere = where & round & (disk.x == 0.0f) & (disk.y == 0.0f) & (disk.z == 0.0f);
    c.smooth = where & !round & ((flags & SHAPE_SMOOTH) != 0u);
    lane_rows(scene->normal_rows, c.smooth ? c.placed.row : splat_uint(0u), c.normals);
    placed_normals(scene, &c.placed, c.normals);
    return c;
}

// The change of `s->shading` by a step along the surface; of what is flat, zero.
static vec3 curvature_change(const Curvature* c, const Surface* s, vec3 step) {
    const vfloat radius = c->row[PRIMITIVE_ROW_RADIUS] * c->row[PRIMITIVE_ROW_FACING];
    vec3 change = choose(c->sphere, scale(step, quotient(splat(1.0f), c->sphere ? radius : splat(1.0f))), vec3_all(0.0f));
    if (!lane_any(c->smooth)) return change;

    // By the change of the barycentric weights
    const vec3 a = vec3_row(c->row, PRIMITIVE_ROW_A);
    const vec3 ab = sub(vec3_row(c->row, PRIMITIVE_ROW_B), a), ac = sub(vec3_row(c->row, PRIMITIVE_ROW_C), a);
    const vec3 normal = outer(ab, ac), scaled = scale(normal, inverse_scale(normal));
    const vfloat inverse = inverse_or_one(inner(normal, scaled));
    const vfloat by_b = inner(outer(step, ac), scaled) * inverse, by_c = inner(outer(ab, step), scaled) * inverse;
    vfloat b, w;
    surface_weights(s, c->row, &b, &w);
    const vec3 blend = placed_normal(&c->placed, surface_blend(c->normals, splat(1.0f) - b - w, b, w));
    const vec3 turn = placed_normal(&c->placed, surface_blend(c->normals, -by_b - by_c, by_b, by_c));
    const vmask usable = c->smooth & (inner(blend, blend) > 1.0e-12f) & (inner(blend, s->normal) > 0.0f);
    const vec3 across = sub(turn, scale(s->shading, inner(turn, s->shading)));
    return choose(usable, scale(across, inverse_magnitude(blend)), change);
}

#endif
