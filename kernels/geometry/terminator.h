// The shadow terminator of coarse meshes, where a shape asks to have it moved (J. Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems
// II, 2021). Interpolated normals stand for a curved surface, but its shadow rays start at a flat triangle, and the neighbours
// hide what the curved surface sees: light ends along the edges of triangles.
//
// So light is scattered at a point that is as far outside as the curved surface is: above the planes that are tangent to it at the three
// vertices, blended by the barycentric weights. Its normal is the interpolated one. Rays that leave this point may meet any
// triangle, its own too. Light samples, paths, and the densities of both start there, so the image is that of a
// scene with such a surface, without bias. Rays still end at the triangles.
#ifndef GEOMETRY_TERMINATOR_H
#define GEOMETRY_TERMINATOR_H

#include "geometry/surface.h"

#ifdef TERMINATOR_OFFSET
// How far the tangent plane at a vertex is above the point, along its normal; below it counts nothing.
static vec3 terminator_step(const Placed* placed, const Surface* s, vec3 vertex, vec3 normal, vfloat weight) {
    const vec3 there = unit(placed_normal(placed, normal)), up = choose(s->front, there, negate(there));
    const vec3 side = choose(s->front, s->normal, negate(s->normal));
    const vfloat below = greater(inner(sub(vertex, s->point), up), splat(0.0f));
    // A normal of length zero, or of the other side, stands for the triangle's own, whose plane the point is in
    return choose(inner(up, side) > 0.0f, scale(up, below * weight), vec3_all(0.0f));
}
#endif

// Move the points of such shapes.
static void terminator_offset(const Scene* scene, Surface* s, vmask active) {
#ifdef TERMINATOR_OFFSET
    s->mesh_point = s->point, s->mesh_normal = s->normal;
    s->moves = s->moves & active;
    if (!lane_any(s->moves)) return;
    const Placed placed = placed_at(scene, s->primitive, surface_time(s));
    vfloat row[16], n[16];
    lane_rows(scene->primitive_rows, placed.row, row);
    placed_geometry(&placed, mask_none(), row);
    lane_rows(scene->normal_rows, s->moves ? placed.row : splat_uint(0u), n);
    placed_normals(scene, &placed, n);
    vfloat b, c;
    surface_weights(s, row, &b, &c);
    const vec3 step_a = terminator_step(&placed, s, vec3_row(row, PRIMITIVE_ROW_A), vec3_row(n, 0), splat(1.0f) - b - c);
    const vec3 step_b = terminator_step(&placed, s, vec3_row(row, PRIMITIVE_ROW_B), vec3_row(n, 3), b);
    const vec3 step_c = terminator_step(&placed, s, vec3_row(row, PRIMITIVE_ROW_C), vec3_row(n, 6), c);
    // Clear of its own triangle, which stays between it and what is below
    const vec3 clear = ray_leave(s->point, s->normal, s->clearance, !s->front);
    s->point = choose(s->moves, add(clear, add(step_a, add(step_b, step_c))), s->point);
    s->normal = choose(s->moves, s->shading, s->normal);
    s->clearance = s->moves ? ray_clearance(s->normal, s->error) : s->clearance;
    s->from = s->moves ? splat_uint(NONE) : s->from;
#endif
}

// The surface as the mesh has it.
static Surface terminator_mesh(const Surface* s) {
    Surface mesh = *s;
#ifdef TERMINATOR_OFFSET
    mesh.point = choose(s->moves, s->mesh_point, s->point);
    mesh.normal = choose(s->moves, s->mesh_normal, s->normal);
    mesh.clearance = s->moves ? ray_clearance(mesh.normal, s->error) : s->clearance;
    mesh.from = s->moves ? s->primitive : s->from;
#endif
    return mesh;
}

// Whether a surface has been moved: then a point of it is not where the ray that found it ended.
static vmask terminator_moved(const Surface* s) {
#ifdef TERMINATOR_OFFSET
    return s->moves;
#else
    return mask_none();
#endif
}

#ifdef INVARIANTS
// Of the mesh: the normal of a point that has been moved is the interpolated one, which may face away from the ray.
static vmask terminator_violates(const Surface* s, const Ray* ray, vmask where) {
    const Surface mesh = terminator_mesh(s);
    return surface_violates(&mesh, ray, where);
}
#endif

#endif
