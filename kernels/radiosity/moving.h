// A shape that moves: it has a tree of its own, as it was when the tree was built, and the scene's tree is over all else. So rays
// are moved back by as far as it has come, and no tree is built anew.
#ifndef RADIOSITY_MOVING_H
#define RADIOSITY_MOVING_H

#include "radiosity/patch.h"

// In `place`: two boxes (low, high) around the shape, before its last step and after; how far it is from where its tree has it; and
// that step.
#define MOVING_BEFORE 0
#define MOVING_AFTER 6
#define MOVING_OFFSET 12
#define MOVING_STEP 15

#define MOVING_PARAMETERS                                                                                                   \
    __global const float *moving_nodes, __global const float *moving_triangles, __global const float *moving_analytic,      \
        __global const float *place, uint moved, uint moved_end, uint convex,
#define MOVING_COLLECT(moving)                                                                                              \
    Moving moving;                                                                                                          \
    moving.tree.nodes = moving_nodes;                                                                                       \
    moving.tree.triangle_packs = moving_triangles;                                                                          \
    moving.tree.analytic_packs = moving_analytic;                                                                           \
    moving.tree.root = 0;                                                                                                   \
    moving.place = place;                                                                                                   \
    moving.first = moved;                                                                                                   \
    moving.end = moved_end;                                                                                                 \
    moving.convex = convex

typedef struct {
    Bvh tree;
    __global const float* place;
    uint first, end;     // sides; none: nothing moves
    uint convex;         // whether rays that leave the front of the shape cannot meet it again
} Moving;

static vmask moving_has(const Moving* moving, vuint side) {
    return side - moving->first < splat_uint(moving->end - moving->first);
}

// The ray among the shape's patches where their tree has them.
static Ray moving_ray(const Moving* moving, const Ray* ray) {
    Ray other = *ray;
    other.origin = sub(ray->origin, vec3_of(splat(moving->place[MOVING_OFFSET]), splat(moving->place[MOVING_OFFSET + 1]),
                                            splat(moving->place[MOVING_OFFSET + 2])));
    return other;
}

// Whether the ray passes a box, before its limit. `box`: low x, y, z and high x, y, z.
static vmask moving_passes_box(const Ray* ray, __global const float* box) {
    vfloat enter = splat(0.0f), leave = ray->limit;
    const vfloat origin[3] = {ray->origin.x, ray->origin.y, ray->origin.z};
    const vfloat direction[3] = {ray->direction.x, ray->direction.y, ray->direction.z};
    for (int axis = 0; axis < 3; ++axis) {
        const vmask flat = absolute(direction[axis]) < 1.0e-30f;
        const vfloat inverse = flat ? splat(1.0e30f) : quotient(splat(1.0f), flat ? splat(1.0f) : direction[axis]);
        const vfloat a = (splat(box[axis]) - origin[axis]) * inverse, b = (splat(box[axis + 3]) - origin[axis]) * inverse;
        enter = greater(enter, lesser(a, b));
        leave = lesser(leave, greater(a, b));
    }
    return enter <= leave;
}

typedef struct {
    vfloat low[3], high[3];
} PatchBox;

// Around a patch, and what rays begin with at it: patch_point's error moves them off by less than the slack.
static PatchBox moving_patch_box(const Scene* scene, vuint side) {
    vfloat row[16];
    PatchBox box;
    lane_rows(scene->primitive_rows, side >> 1, row);
    vfloat slack = splat(0.0f);
    for (int axis = 0; axis < 3; ++axis) {
        const vfloat a = row[PRIMITIVE_ROW_A + axis], b = row[PRIMITIVE_ROW_B + axis], c = row[PRIMITIVE_ROW_C + axis];
        box.low[axis] = lesser(lesser(a, b), c);
        box.high[axis] = greater(greater(a, b), c);
        slack = slack + (absolute(box.low[axis]) + absolute(box.high[axis])) * (64.0f * EPSILON);
    }
    for (int axis = 0; axis < 3; ++axis) {
        box.low[axis] = box.low[axis] - slack;
        box.high[axis] = box.high[axis] + slack;
    }
    return box;
}

// Of a line's part [enter, leave] that where a number that goes from p to q along it is not negative.
static void moving_narrow(vfloat p, vfloat q, vfloat* enter, vfloat* leave) {
    const vmask in = p >= 0.0f, out = q >= 0.0f;
    const vfloat at = quotient(p, (in & out) | (!in & !out) ? splat(1.0f) : p - q);
    *enter = in ? *enter : greater(*enter, out ? at : splat(2.0f));
    *leave = in & !out ? lesser(*leave, at) : *leave;
}

// Whether a straight line from one patch's box to another's may pass a third box: the box around the line's point sweeps from the one
// to the other, each face evenly.
static vmask moving_between(const PatchBox* from, const PatchBox* to, __global const float* box) {
    vfloat enter = splat(0.0f), leave = splat(1.0f);
    for (int axis = 0; axis < 3; ++axis) {
        moving_narrow(from->high[axis] - box[axis], to->high[axis] - box[axis], &enter, &leave);
        moving_narrow(box[axis + 3] - from->low[axis], box[axis + 3] - to->low[axis], &enter, &leave);
    }
    return enter <= leave;
}

#endif
