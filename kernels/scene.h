// The scene as the integrators see it. This list is the only one: kernel parameters, the struct and the host's check come from it.
#ifndef SCENE_H
#define SCENE_H

#include "geometry/bvh.h"
#include "types.h"

// Rows are sixteen floats (core/lane.h, lane_rows); kernels/geometry/rows.cl writes them.
#define SCENE_ARRAYS(X)                                                                                                     \
    X(float, primitive_rows) /* triangle: A, B, C; round: centre, radius, normal, facing; then what it is made of */        \
    X(float, normal_rows)    /* triangle: normals at A, B, C; one row where no shape is smooth */                           \
    X(float, material_rows)  /* of materials that need more numbers than fit into a primitive's row: two each */               \
    X(float, albedo_tables)  /* how much light the lobes of rough materials reflect: material/albedo.h */                        \
    X(float, light_rows)     /* radiance, kind, probability or place in the tree, primitive, geometry */                      \
    X(float, light_alias)    /* alias table: threshold and alias of each light */                                           \
    X(float, light_nodes)    /* tree of lights: both children of each node (light/tree.h) */                                \
    X(float, light_order)    /* its last level: the lights, as bits */                                                      \
    X(float, nodes)          /* the tree: geometry/bvh.h */                                                                 \
    X(float, triangle_packs)                                                                                                \
    X(float, analytic_packs)                                                                                                \
    X(Camera, camera)                                                                                                       \
    X(Settings, settings)

#define SCENE_MEMBER_(type, name) __global const type* name;
#define SCENE_PARAMETER_(type, name) __global const type *name,
#define SCENE_COPY_(type, name) scene.name = name;

// The last number of a primitive's row: the kind of material below this bit, the flags of the shape from it on.
#define ROW_FLAGS 16u

typedef struct {
    SCENE_ARRAYS(SCENE_MEMBER_)
    Bvh bvh;
} Scene;

// First in a kernel's parameters, and first in its body.
#define SCENE_PARAMETERS SCENE_ARRAYS(SCENE_PARAMETER_)
#define SCENE_COLLECT(scene)                                                                                                \
    Scene scene;                                                                                                            \
    SCENE_ARRAYS(SCENE_COPY_)                                                                                               \
    scene.bvh.nodes = nodes;                                                                                                \
    scene.bvh.triangle_packs = triangle_packs;                                                                              \
    scene.bvh.analytic_packs = analytic_packs;                                                                              \
    scene.bvh.root = 0

#endif
