// From a hit to the point that is shaded: where it is, which way it faces, what it is made of, whether it shines.
#ifndef GEOMETRY_SURFACE_H
#define GEOMETRY_SURFACE_H

#include "core/frame.h"
#include "core/lane.h"
#include "core/sampler.h"
#include "geometry/curve.h"
#include "geometry/instance.h"
#include "geometry/ray.h"
#include "geometry/traverse.h"
#include "plugin/given.h"
#include "scene.h"
#include "spectral/color.h"
#ifdef TEXTURES
#include "texture/mapping.h"
#endif

typedef struct {
    vec3 point;
    vec3 error;          // bound of its rounding error, by component
    vfloat clearance;    // how far along the normal a ray that leaves has to start: ray_clearance
    vec3 normal;         // of the geometry, unit, out of the front side
    vec3 shading;        // interpolated where the shape's vertices have normals, on the same side
    vmask front;         // the ray came from the front side
    vuint primitive;
    vuint from;          // what a ray leaving here cannot hit again: Ray.from
    vuint light;         // index of the light it is, or NONE
    vec3 color;
    vfloat termination, ior;
    vuint kind;          // MATERIAL_*
#ifdef DISPERSION
    vmask disperses;     // its index depends on the wavelength
    vfloat index;        // and is this, as color_index reads it
#endif
#ifdef TEXTURES
    Attributes attributes;
#endif
#ifdef INTERIORS
    vuint medium;        // behind the front: material/interior.h
#endif
#ifdef MEDIA
    vfloat g;            // of kind MATERIAL_MEDIUM: a point of a medium, which scatters by this mean cosine
#endif
#ifdef HIDDEN_SHAPES
    vmask hidden;        // rays of the camera pass it
    vmask held_out;      // rays of the camera end there, as if nothing were there
#endif
#ifdef TERMINATOR_OFFSET
    vmask moves;         // its shadow terminator is to be moved: geometry/terminator.h
    vec3 mesh_point, mesh_normal;        // which then changes the point and the normal; these are the triangle's
#endif
#ifdef MOTION
    vfloat time;         // of the ray that found it
#endif
#ifdef CURVES
    vmask curve;
    vec3 tangent;        // of a curve: unit, along it, square to the normal
    vfloat along;        // of a curve: from its beginning, 0, to its end, 1
    vfloat radius;       // of a curve
#endif
} Surface;

#ifdef MOTION
static vfloat surface_time(const Surface* s) { return s->time; }
#else
static vfloat surface_time(const Surface* s) { return splat(0.0f); }
#endif

// What a row has at A, B and C, nine numbers from its first column on, at the point with these barycentric weights.
static vec3 surface_blend(const vfloat row[16], vfloat weight_a, vfloat weight_b, vfloat weight_c) {
    const vec3 a = vec3_row(row, 0), b = vec3_row(row, 3), c = vec3_row(row, 6);
    return along(along(scale(c, weight_c), b, weight_b), a, weight_a);
}

// Triangles: the barycentric weights are found again, in all lanes at once, which is cheaper than carrying them along. The point is
// then on the triangle to within the rounding of its coordinates, however far the ray came.
static void surface_triangle(const Scene* scene, const Ray* ray, const Placed* placed, const vfloat row[16], vmask smooth, Surface* s) {
    const vec3 a = vec3_row(row, PRIMITIVE_ROW_A), ab = sub(vec3_row(row, PRIMITIVE_ROW_B), a), ac = sub(vec3_row(row, PRIMITIVE_ROW_C), a);
    const vec3 normal = outer(ab, ac), across = outer(sub(a, ray->origin), ray->direction);
    const vfloat determinant = inner(normal, ray->direction);
    const vfloat inverse = quotient(splat(1.0f), determinant != 0.0f ? determinant : splat(1.0f));
    const vfloat weight_b = bounded(inner(across, ac) * inverse, 0.0f, 1.0f);
    const vfloat weight_c = lesser(greater(-inner(across, ab) * inverse, splat(0.0f)), splat(1.0f) - weight_b);
    const vec3 step_b = scale(ab, weight_b), step_c = scale(ac, weight_c);
    s->point = add(a, add(step_b, step_c));
    // That far the plane of a neighbour may seem to stand out of this one's: the error of its normal, over the length of its edges.
    s->error = scale(vec3_of(absolute(a.x) + absolute(ab.x) + absolute(ac.x), absolute(a.y) + absolute(ab.y) + absolute(ac.y),
                             absolute(a.z) + absolute(ab.z) + absolute(ac.z)),
                     splat(16.0f * EPSILON));
    s->normal = placed_front(placed, unit(normal));
    s->shading = s->normal;
    s->from = s->primitive;
#ifdef TEXTURES
    s->attributes.ab = ab, s->attributes.ac = ac;
    s->attributes.weight_b = weight_b, s->attributes.weight_c = weight_c;
#endif
    if (lane_any(smooth)) {
        vfloat n[16];
        lane_rows(scene->normal_rows, smooth ? placed->row : splat_uint(0u), n);
        placed_normals(scene, placed, n);
        const vfloat weight_a = splat(1.0f) - weight_b - weight_c;
        const vec3 blend = placed_normal(placed, surface_blend(n, weight_a, weight_b, weight_c));
        // Where the blend turns away from the triangle all the same, the triangle's own normal stands in
        const vmask usable = smooth & (inner(blend, blend) > 1.0e-12f) & (inner(blend, s->normal) > 0.0f);
        s->shading = choose(usable, unit(blend), s->normal);
    }
}

#ifdef CURVES
static void surface_curve(const Scene* scene, const Ray* ray, const Placed* placed, Surface* s) {
    const CurvePoint p = curve_point(scene, ray, placed, s->curve);
    s->point = choose(s->curve, p.point, s->point);
    s->error = choose(s->curve, p.error, s->error);
    s->normal = choose(s->curve, p.normal, s->normal);
    s->shading = choose(s->curve, p.normal, s->shading);
    s->radius = p.radius;
    s->tangent = p.tangent;
    s->along = p.along;
    s->from = s->curve ? splat_uint(NONE) : s->from;     // a curve that bends can be hit again
#ifdef TEXTURES
    s->attributes.weight_b = s->curve ? p.along : s->attributes.weight_b;
    s->attributes.weight_c = s->curve ? splat(0.5f) : s->attributes.weight_c;
    s->attributes.ab = choose(s->curve, scale(p.tangent, p.pace), s->attributes.ab);
    s->attributes.ac = choose(s->curve, outer(p.normal, p.tangent), s->attributes.ac);
#endif
}
#endif

static void surface_round(const Ray* ray, vfloat distance, const vfloat row[16], vmask round, Surface* s) {
    const vec3 center = vec3_row(row, PRIMITIVE_ROW_CENTER), disk_normal = vec3_row(row, PRIMITIVE_ROW_NORMAL);
    const vfloat radius = row[PRIMITIVE_ROW_RADIUS];
    const vmask disk = round & ((disk_normal.x != 0.0f) | (disk_normal.y != 0.0f) | (disk_normal.z != 0.0f));
    const vec3 from_center = sub(along(ray->origin, ray->direction, distance), center);
    const vec3 outward = unit(from_center);
    const vec3 on_sphere = along(center, outward, radius);
    const vec3 on_disk = add(center, along(from_center, disk_normal, -inner(from_center, disk_normal)));
    const vec3 normal = choose(disk, disk_normal, scale(outward, row[PRIMITIVE_ROW_FACING]));
    s->point = choose(round, choose(disk, on_disk, on_sphere), s->point);
    s->error = choose(round,
                      scale(vec3_of(absolute(center.x) + radius, absolute(center.y) + radius, absolute(center.z) + radius),
                            splat(8.0f * EPSILON)),
                      s->error);
    s->normal = choose(round, normal, s->normal);
    s->shading = choose(round, normal, s->shading);
    s->from = (round & !disk) ? splat_uint(NONE) : s->from;      // a sphere can be hit again from inside
#ifdef TEXTURES
    s->attributes.sphere = round & !disk, s->attributes.disk = disk;
    s->attributes.radius = radius;
    s->attributes.out = choose(disk, scale(sub(on_disk, center), inverse_or_one(radius)), outward);
#endif
}

#ifdef TEXTURES
// Choose among texels at random from here on: at the vertex of a path at this depth.
static void surface_random(Surface* s, Sampler sampler, vuint depth) {
    vuint bits_u, bits_v;
    sampler_hash_bits(sampler, sampler_set(depth, SET_TEXTURE), &bits_u, &bits_v);
    s->attributes.taps.u = unit_interval(bits_u), s->attributes.taps.v = unit_interval(bits_v);
    s->attributes.taps.random = 1;
}
#else
static void surface_random(Surface* s, Sampler sampler, vuint depth) {}
#endif

// The rows that surface_at will read, asked for before it is needed where there are many.
static void surface_prefetch(const Scene* scene, Hit hit) {
#if PACKETS > 1
    uint primitive[LANES];
    const vmask plain = hit.primitive < scene->settings->primitive_count;     // of instances it would take as long to find the row
    lane_store((plain ? hit.primitive : splat_uint(0u)), primitive);
    for (int lane = 0; lane < LANES; ++lane) prefetch_line(scene->primitive_rows + (size_t)primitive[lane] * 16);
#endif
}

static Surface surface_at(const Scene* scene, const Ray* ray, Hit hit, vmask active) {
    Surface s;
    vfloat row[16];
    s.primitive = active ? hit.primitive : splat_uint(0u);
#ifdef MOTION
    s.time = ray->time;
#endif
    const Placed placed = placed_at(scene, s.primitive, ray_time(ray));
    lane_rows(scene->primitive_rows, placed.row, row);
    s.color = vec3_row(row, PRIMITIVE_ROW_COLOR);
    s.termination = row[PRIMITIVE_ROW_TERMINATION];
#ifdef DISPERSION
    s.disperses = mask_none();
    s.index = row[PRIMITIVE_ROW_IOR];
    s.ior = color_index(scene, s.index, &s.disperses);
#else
    s.ior = row[PRIMITIVE_ROW_IOR];
#endif
    s.light = vfloat_bits(row[PRIMITIVE_ROW_LIGHT]);
    const vuint kind_and_flags = vfloat_bits(row[PRIMITIVE_ROW_KIND]);
    s.kind = kind_and_flags & ((1u << ROW_FLAGS) - 1u);
#ifdef INTERIORS
    s.medium = kind_and_flags >> ROW_MEDIUM;
#endif
#ifdef MEDIA
    s.g = splat(0.0f);
#endif
    const vmask round = placed.row >= scene->settings->triangle_count;
    placed_geometry(&placed, round, row);
    const vmask smooth = active & !round & ((kind_and_flags & (SHAPE_SMOOTH << ROW_FLAGS)) != 0u);
#ifdef HIDDEN_SHAPES
    s.hidden = active & ((kind_and_flags & (SHAPE_HIDDEN << ROW_FLAGS)) != 0u);
    s.held_out = active & ((kind_and_flags & (SHAPE_HELD_OUT << ROW_FLAGS)) != 0u);
#endif
#ifdef TERMINATOR_OFFSET
    s.moves = smooth & ((kind_and_flags & (SHAPE_TERMINATOR_OFFSET << ROW_FLAGS)) != 0u);
#endif
#ifdef TEXTURES
    s.attributes = mapping_attributes(scene, placed.row, active & ((kind_and_flags & (SHAPE_TEXTURED << ROW_FLAGS)) != 0u));
#ifdef CURVES
    placed_axes(&placed, round & !curve_is(row, round), s.attributes.row);      // that of a curve has coordinates, as a triangle's
#else
    placed_axes(&placed, round, s.attributes.row);
#endif
#if defined(TANGENTS) && defined(INSTANCES)
    s.attributes.placed = placed;
#endif
#endif
    surface_triangle(scene, ray, &placed, row, smooth, &s);
#ifdef CURVES
    s.curve = active & curve_is(row, round);
    s.tangent = vec3_all(0.0f);
    s.along = splat(0.0f);
    const vmask plain = round & !s.curve;
#else
    const vmask plain = round;
#endif
    if (lane_any(plain)) surface_round(ray, hit.distance, row, plain, &s);
#ifdef CURVES
    if (lane_any(s.curve)) surface_curve(scene, ray, &placed, &s);
#endif
    s.error = placed_error(&placed, s.point, s.error);
    s.clearance = ray_clearance(s.normal, s.error);
    s.front = inner(s.normal, ray->direction) < 0.0f;
#ifdef PLUGIN_TEXTURES
    s.attributes.point = s.point;
#endif
    return s;
}

// Where the point is on its triangle: the barycentric weights of B and C, as rounding leaves them.
static void surface_weights(const Surface* s, const vfloat row[16], vfloat* b, vfloat* c) {
    const vec3 at = vec3_row(row, PRIMITIVE_ROW_A), to = sub(s->point, at);
    const vec3 ab = sub(vec3_row(row, PRIMITIVE_ROW_B), at), ac = sub(vec3_row(row, PRIMITIVE_ROW_C), at);
    const vec3 normal = outer(ab, ac), scaled = scale(normal, inverse_scale(normal));
    const vfloat inverse = inverse_or_one(inner(normal, scaled));
    *b = inner(outer(to, ac), scaled) * inverse;
    *c = inner(outer(ab, to), scaled) * inverse;
}

// A ray that leaves the surface on the side its direction points to.
static Ray surface_leave(const Surface* s, vec3 direction) {
    Ray ray = ray_make(ray_leave(s->point, s->normal, s->clearance, inner(direction, s->normal) < 0.0f), direction);
    ray.from = s->from;
    return ray_in_time(ray, surface_time(s));
}

#ifdef INVARIANTS
static vmask surface_violates(const Surface* s, const Ray* ray, vmask where) {
    const vfloat facing = inner(s->normal, ray->direction);
    const vmask normals = invariant_unit(s->normal) & invariant_unit(s->shading) & (s->front ? facing <= INVARIANT_SLACK : facing >= -INVARIANT_SLACK);
    const vmask place = invariant_finite3(s->point) & invariant_positive3(s->error) & invariant_positive(s->clearance);
    return where & !(normals & place & (s->primitive != NONE));
}
#endif

#endif
