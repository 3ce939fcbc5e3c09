// Instances: groups of shapes that stand in the scene many times, each time under an affine map of its own.
//
// The tree over the scene leads to an instance's number, its row to the tree of its group, which a ray goes through in the group's own
// space (bvh_packet.h, bvh_single.h). Its direction is not made a unit vector there, so distances along it stay the same.
//
// Primitives are numbered as if all instances were written out, which is all that a hit, a ray or a light sample has to know. A primitive
// of an instance has the rows of its group's primitive. Its geometry is carried into the world when its surface is looked at, so that all
// that follows knows of no instances.
//
// Built only where a scene has any (-D INSTANCES).
#ifndef GEOMETRY_INSTANCE_H
#define GEOMETRY_INSTANCE_H

#include "core/exact.h"
#include "core/lane.h"
#include "geometry/motion.h"
#include "geometry/pose.h"
#include "geometry/wide.h"
#include "scene.h"

typedef struct {
    vuint row;               // of a primitive in the tables of the scene
#ifdef INSTANCES
    vmask present;           // it is one of an instance
#ifdef MOTION
    vmask moves;             // which moves
#endif
#ifdef DEFORMATION
    vmask deforms;           // its mesh changes its form
    vuint pose, next_pose, pose_normals;     // rows of its corners before and after that time, and how far behind each is that of its normals
    vfloat pose_share;
    vfloat corners[9];       // at that time
#endif
    vfloat instance[16];     // INSTANCE_ROW_*
    vfloat placement[16];    // PLACEMENT_ROW_*
#endif
} Placed;

#ifdef INSTANCES

// The head of instance_guides: number of the first primitive of an instance, and how many bits of a number, less that, share a guide.
#define INSTANCE_GUIDES_FIRST 0
#define INSTANCE_GUIDES_SHIFT 1
#define INSTANCE_GUIDES 2

// Numbers from `first` on belong to instances.
static vmask instance_owns(const Scene* scene, vuint primitive) {
    return primitive >= scene->instance_guides[INSTANCE_GUIDES_FIRST];
}

// Of the instances the one that these primitives belong to: the last whose first number is not above theirs.
static vuint instance_of(const Scene* scene, vuint primitive, vmask asked) {
    __global const uint* guides = scene->instance_guides;
    const vuint bucket = asked ? (primitive - guides[INSTANCE_GUIDES_FIRST]) >> guides[INSTANCE_GUIDES_SHIFT] : splat_uint(0u);
    const vuint at = bucket + INSTANCE_GUIDES, after = at + 1u;
    vuint low = LANE_LOOK_UP(uint, guides, at), high = LANE_LOOK_UP(uint, guides, after);
    while (lane_any(asked & (low < high))) {
        const vuint middle = (low + high + 1u) >> 1;
        const vuint first = vfloat_bits(lane_gather(scene->instance_rows, middle * INSTANCE_WORDS + (16u + PLACEMENT_ROW_FIRST)));
        const vmask reached = first <= primitive;
        high = reached | !(low < high) ? high : middle - 1u;       // lanes that are done wait for the others
        low = reached ? middle : low;
    }
    return low;
}

#ifdef MOTION
// An instance's two maps at a time, in the place of those without its motion.
static void placed_move(const Scene* scene, Placed* p, vuint instance, vfloat time) {
    const vuint at = p->present ? instance * INSTANCE_MOTION_WORDS : splat_uint(0u), after = at + 1u;
    const vuint first = LANE_LOOK_UP(uint, scene->instance_motions, at), segments = LANE_LOOK_UP(uint, scene->instance_motions, after);
    p->moves = p->present & (segments > 0u);
    if (!lane_any(p->moves)) return;
    MotionMap map;
    motion_at(scene->motion_rows, p->moves ? first : splat_uint(0u), p->moves ? segments : splat_uint(0u), time, &map);
    vfloat* out = p->placement + PLACEMENT_ROW_TO_WORLD;
    vfloat* in = p->instance + INSTANCE_ROW_TO_OBJECT;
    for (int column = 0; column < 4; ++column) {
        const vec3 moved = motion_turned(map.linear, vec3_of(out[column], out[4 + column], out[8 + column]));
        const vec3 there = column == 3 ? add(moved, motion_offset(&map)) : moved;
        out[column] = p->moves ? there.x : out[column];
        out[4 + column] = p->moves ? there.y : out[4 + column];
        out[8 + column] = p->moves ? there.z : out[8 + column];
    }
    // Of the way back, what turns the offset's opposite is turned again by the map without motion
    const vec3 back = motion_turned(map.inverse, negate(motion_offset(&map)));
    for (int row = 0; row < 3; ++row) {
        const vfloat x = in[4 * row], y = in[4 * row + 1], z = in[4 * row + 2];
        for (int column = 0; column < 3; ++column) {
            const vfloat way = ray_carried_lanes(x, y, z, splat(0.0f), map.inverse[column], map.inverse[3 + column], map.inverse[6 + column]);
            in[4 * row + column] = p->moves ? way : in[4 * row + column];
        }
        const vfloat offset = ray_carried_lanes(x, y, z, in[4 * row + 3], back.x, back.y, back.z);
        in[4 * row + 3] = p->moves ? offset : in[4 * row + 3];
    }
    const vfloat factor = magnitude(vec3_of(out[0], out[4], out[8]));
    p->placement[PLACEMENT_ROW_SCALE] = p->moves ? factor : p->placement[PLACEMENT_ROW_SCALE];
}
#endif

#ifdef DEFORMATION
// The corners of a triangle at a time, of a mesh that changes its form.
static void placed_pose(const Scene* scene, Placed* p, vuint primitive, vuint instance, vfloat time) {
    const vuint at = (p->present ? instance * INSTANCE_MOTION_WORDS : splat_uint(0u)) + 2u, after = at + 1u;
    const vuint first = LANE_LOOK_UP(uint, scene->instance_motions, at), knots = LANE_LOOK_UP(uint, scene->instance_motions, after);
    p->deforms = p->present & (knots > 0u);
    if (!lane_any(p->deforms)) return;
    const vuint begin = vfloat_bits(p->placement[PLACEMENT_ROW_FIRST]);
    const vuint stride = vfloat_bits(p->placement[PLACEMENT_ROW_FIRST_ANALYTIC]) - begin;
    const vuint none = splat_uint(0u);
    pose_rows(scene->motion_rows, p->deforms ? first + (primitive - begin) : none, p->deforms ? stride : none, p->deforms ? knots : none, time,
              &p->pose, &p->next_pose, &p->pose_share);
    p->pose_normals = stride * knots;
    pose_numbers(scene->motion_rows, p->pose, p->next_pose, p->pose_share, p->corners);
}
#endif

// Where the primitives with these numbers are at a time.
static Placed placed_at(const Scene* scene, vuint primitive, vfloat time) {
    Placed p;
    p.row = primitive;
    p.present = instance_owns(scene, primitive);
#ifdef MOTION
    p.moves = mask_none();
#endif
#ifdef DEFORMATION
    p.deforms = mask_none();
#endif
    if (!lane_any(p.present)) {
        for (int k = 0; k < 16; ++k) p.instance[k] = p.placement[k] = splat(0.0f);
        return p;
    }
    const vuint instance = instance_of(scene, primitive, p.present);
    lane_rows(scene->instance_rows, instance * 2u, p.instance);
    lane_rows(scene->instance_rows, instance * 2u + 1u, p.placement);
    const vmask analytic = primitive >= vfloat_bits(p.placement[PLACEMENT_ROW_FIRST_ANALYTIC]);
    const vuint offset = vfloat_bits(analytic ? p.instance[INSTANCE_ROW_ANALYTIC_OFFSET] : p.instance[INSTANCE_ROW_TRIANGLE_OFFSET]);
    p.row = p.present ? primitive - offset : primitive;
#ifdef MOTION
    placed_move(scene, &p, instance, time);
#endif
#ifdef DEFORMATION
    placed_pose(scene, &p, primitive, instance, time);
#endif
    return p;
}

// A map of a row, applied to a point; its linear part, to a vector.
static vec3 placed_point(const vfloat m[12], vec3 p) {
    return vec3_of(ray_carried_lanes(m[0], m[1], m[2], m[3], p.x, p.y, p.z), ray_carried_lanes(m[4], m[5], m[6], m[7], p.x, p.y, p.z),
                   ray_carried_lanes(m[8], m[9], m[10], m[11], p.x, p.y, p.z));
}
static vec3 placed_vector(const vfloat m[12], vec3 v) {
    const vfloat none = splat(0.0f);
    return vec3_of(ray_carried_lanes(m[0], m[1], m[2], none, v.x, v.y, v.z), ray_carried_lanes(m[4], m[5], m[6], none, v.x, v.y, v.z),
                   ray_carried_lanes(m[8], m[9], m[10], none, v.x, v.y, v.z));
}

// A vector that only turns, under a map that is a similarity.
static vec3 placed_turned(const Placed* p, vec3 v) {
    return scale(placed_vector(p->placement + PLACEMENT_ROW_TO_WORLD, v), inverse_or_one(p->placement[PLACEMENT_ROW_SCALE]));
}

// The geometry in a primitive's row, carried into the world; of a sphere or disk, which only similarities place, where `round` holds.
static void placed_geometry(const Placed* p, vmask round, vfloat row[16]) {
    if (!lane_any(p->present)) return;
#ifdef DEFORMATION
    if (lane_any(p->deforms))
        for (int k = 0; k < 9; ++k) row[k] = p->deforms ? p->corners[k] : row[k];
#endif
    const vfloat* m = p->placement + PLACEMENT_ROW_TO_WORLD;
    const vmask flat = p->present & !round, curved = p->present & round;
    const vec3 normal = vec3_row(row, PRIMITIVE_ROW_NORMAL);
    const vec3 a = vec3_row(row, PRIMITIVE_ROW_A), b = vec3_row(row, PRIMITIVE_ROW_B), c = vec3_row(row, PRIMITIVE_ROW_C);
    vec3_row_put(row, PRIMITIVE_ROW_A, choose(p->present, placed_point(m, a), a));       // of what is round the centre
    vec3_row_put(row, PRIMITIVE_ROW_B, choose(flat, placed_point(m, b), b));
    vec3_row_put(row, PRIMITIVE_ROW_C, choose(flat, placed_point(m, c), c));
    if (!lane_any(curved)) return;
    const vec3 turned = placed_turned(p, normal);
    row[PRIMITIVE_ROW_RADIUS] = curved ? row[PRIMITIVE_ROW_RADIUS] * p->placement[PLACEMENT_ROW_SCALE] : row[PRIMITIVE_ROW_RADIUS];
    const vec3 there = choose(curved, turned, vec3_row(row, PRIMITIVE_ROW_NORMAL));
    vec3_row_put(row, PRIMITIVE_ROW_NORMAL, there);
}

// The normal of a triangle's corners points to its front, but for those that are mirrored.
static vec3 placed_front(const Placed* p, vec3 normal) {
    const vmask mirrored = p->present & (p->placement[PLACEMENT_ROW_FACING] < 0.0f);
    return choose(mirrored, negate(normal), normal);
}

// Normals at a triangle's corners, in the place of those of another time.
static void placed_normals(const Scene* scene, const Placed* p, vfloat normals[16]) {
#ifdef DEFORMATION
    if (!lane_any(p->deforms)) return;
    vfloat now[9];
    const vuint none = splat_uint(0u);
    pose_numbers(scene->motion_rows, p->deforms ? p->pose + p->pose_normals : none, p->deforms ? p->next_pose + p->pose_normals : none,
                 p->pose_share, now);
    for (int k = 0; k < 9; ++k) normals[k] = p->deforms ? now[k] : normals[k];
#endif
}

// A normal of the group's, in the world, of any length: the transpose of the map into the group's space carries it.
static vec3 placed_normal(const Placed* p, vec3 n) {
    const vfloat* m = p->instance + INSTANCE_ROW_TO_OBJECT;
    const vec3 x = vec3_of(m[0], m[1], m[2]), y = vec3_of(m[4], m[5], m[6]), z = vec3_of(m[8], m[9], m[10]);
    return choose(p->present, along(along(scale(z, n.z), y, n.y), x, n.x), n);
}

// The axes of a sphere's or disk's textures.
static void placed_axes(const Placed* p, vmask round, vfloat row[16]) {
    const vmask curved = p->present & round;
    if (!lane_any(curved)) return;
    for (int k = 0; k < 9; k += 3) vec3_row_put(row, k, choose(curved, placed_turned(p, vec3_row(row, k)), vec3_row(row, k)));
}

// A direction along a triangle; what is to its left and right changes places in a mirror.
static vec3 placed_tangent(const Placed* p, vec3 tangent, vfloat* sign) {
    *sign = p->present ? *sign * p->placement[PLACEMENT_ROW_FACING] : *sign;
    return choose(p->present, placed_vector(p->placement + PLACEMENT_ROW_TO_WORLD, tangent), tangent);
}

static vec3 placed_sizes(const vfloat m[12], vec3 p) {
    vfloat size[12];
    for (int k = 0; k < 12; ++k) size[k] = absolute(m[k]);
    return placed_point(size, vec3_of(absolute(p.x), absolute(p.y), absolute(p.z)));
}

#ifdef MOTION
// The maps of what moves are computed where they are needed, each entry from all others: their errors have nothing to do with the sizes of
// single entries, only with the largest. Roundings of a rotation and its transpose, of products with a stretch and its inverse, and of two maps.
#define MOTION_ROUNDINGS 64.0f

static vfloat placed_largest(const vfloat m[12]) {
    vfloat most = splat(0.0f);
    for (int k = 0; k < 12; ++k)
        if (k % 4 != 3) most = greater(most, absolute(m[k]));
    return most;
}
static vec3 placed_spread(const Placed* p, vec3 point) {
    const vfloat* out = p->placement + PLACEMENT_ROW_TO_WORLD;
    const vfloat sizes = placed_largest(out) * placed_largest(p->instance + INSTANCE_ROW_TO_OBJECT);
    const vec3 from = sub(point, vec3_of(out[3], out[7], out[11]));
    const vfloat reach = absolute(from.x) + absolute(from.y) + absolute(from.z);
    const vfloat away = absolute(point.x) + absolute(point.y) + absolute(point.z), spread = fma(sizes, reach, away);
    return vec3_of(spread, spread, spread);
}
#endif

// How far from a point of the surface, by component, a ray that leaves it may find the surface: the way into the group's space and back
// rounds each number a few times, and those of the map into it are carried back by the other (PBR 4ed, 6.8.6).
static vec3 placed_error(const Placed* p, vec3 point, vec3 error) {
    if (!lane_any(p->present)) return error;
    const vec3 inside = placed_sizes(p->instance + INSTANCE_ROW_TO_OBJECT, point);
    const vec3 outside = placed_sizes(p->placement + PLACEMENT_ROW_TO_WORLD, inside);
    const vec3 resting = choose(p->present, along(error, outside, splat(8.0f * EPSILON)), error);
#ifdef MOTION
    return choose(p->moves, along(error, placed_spread(p, point), splat(MOTION_ROUNDINGS * EPSILON)), resting);
#else
    return resting;
#endif
}

#else

static Placed placed_at(const Scene* scene, vuint primitive, vfloat time) {
    Placed p;
    p.row = primitive;
    return p;
}
static void placed_geometry(const Placed* p, vmask round, vfloat row[16]) {}
static vec3 placed_front(const Placed* p, vec3 normal) { return normal; }
static void placed_normals(const Scene* scene, const Placed* p, vfloat normals[16]) {}
static vec3 placed_normal(const Placed* p, vec3 n) { return n; }
static void placed_axes(const Placed* p, vmask round, vfloat row[16]) {}
static vec3 placed_error(const Placed* p, vec3 point, vec3 error) { return error; }

#endif

#endif
