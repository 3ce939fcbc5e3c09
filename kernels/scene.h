// The scene as the integrators see it. This list is the only one: kernel parameters, the struct and the host's check come from it.
#ifndef SCENE_H
#define SCENE_H

#include "geometry/bvh.h"
#include "spectral/wavelengths.h"
#include "types.h"
#ifdef PATH_GUIDED
#include "guiding/field.h"
#endif

// Rows are sixteen floats (core/lane.h, lane_rows); kernels/geometry/rows.cl writes them.
#define SCENE_ARRAYS(X)                                                                                                     \
    X(float, primitive_rows) /* triangle: A, B, C; round: centre, radius, normal, facing; then what it is made of */        \
    X(float, normal_rows)    /* triangle: normals at A, B, C; one row where no shape is smooth */                           \
    X(float, material_rows)  /* of materials that need more numbers than fit into a primitive's row: two each */               \
    X(float, albedo_tables)  /* how much light the lobes of rough materials reflect: material/albedo.h */                        \
    X(float, media_rows)     /* of dielectrics, where paths carry a list of them: material/interior.h */                            \
    X(float, curve_rows)     /* of curves, the number of their row less that of the first sphere: geometry/curve.inc */         \
    X(float, grid_rows)      /* of media whose density varies, two each: medium/grid.h */                                   \
    X(float, grid_words)     /* and their densities, in bricks */                                                           \
    X(float, measured_rows)  /* of measured reflectance, two each: material/lobe/measured.h */                               \
    X(float, measured_words) /* and its tables */                                                                           \
    X(float, thin_film_rows) /* eight each: means over wavelengths, and then of each material its film: material/thin_film.h */   \
    X(float, attribute_rows) /* of primitives with textures: texture coordinates, and which textures; else one row */          \
    X(float, texture_rows)   /* of each texture: which picture, and how it lies */                                             \
    X(float, texture_slots)  /* of each material: which textures stand for its parameters */                                   \
    X(float, texel_values)   /* what numbers of 8 and 16 bits in pictures stand for */                                         \
    X(uint, hole_rows)       /* of masked triangles: where they have holes */                                                   \
    X(uint, texels_0)        /* the pictures, in pages: texture/texel.h */                                                     \
    X(uint, texels_1)                                                                                                       \
    X(uint, texels_2)                                                                                                       \
    X(uint, texels_3)                                                                                                       \
    X(float, light_rows)     /* radiance, kind, probability or place in the tree, primitive, geometry */                      \
    X(float, light_alias)    /* alias table: threshold and alias of each light */                                           \
    X(float, light_nodes)    /* tree of lights: both children of each node (light/tree.h) */                                \
    X(float, light_order)    /* its last level: the lights, as bits */                                                      \
    X(float, light_cones)    /* of the same children where they shine to, where a scene has lamps */                        \
    X(float, lamp_tables)    /* intensities of lamps by direction: light/lamp.h */                                          \
    X(float, environment_map) /* picture of the environment, and sums of its light: light/environment.h */                  \
    X(float, nodes)          /* the tree: geometry/bvh.h */                                                                 \
    X(float, triangle_packs)                                                                                                \
    X(float, analytic_packs)                                                                                                \
    X(float, masked_nodes)   /* the tree over what rays may pass: geometry/find.h */                                        \
    X(float, masked_triangle_packs)                                                                                         \
    X(float, masked_analytic_packs)                                                                                         \
    X(float, instance_rows)  /* of instances, two each: geometry/instance.h */                                              \
    X(uint, instance_guides) /* which of them a primitive's number belongs to */                                            \
    X(uint, instance_motions) /* of each, where its motion is among these knots: geometry/motion.h */                        \
    X(float, motion_rows)                                                                                                   \
    X(float, camera_knots)   /* and those of cameras that move */                                                           \
    X(float, spectra)        /* tables of wavelengths: spectral/color.h */                                                  \
    X(float, chain_table)    /* of specular chains, where they are sampled: specular/table.h */                             \
    X(Camera, camera)                                                                                                       \
    X(Settings, settings)

#define SCENE_MEMBER_(type, name) __global const type* name;
// No kernel writes to them: `restrict` lets a compiler read them through the cache for what does not change.
#define SCENE_PARAMETER_(type, name) __global const type *restrict name,
#define SCENE_COPY_(type, name) scene.name = name;

// The last number of a primitive's row: the kind of material below this bit, the flags of the shape from it on.
#define ROW_FLAGS 16u
// And from this bit on, the number of the medium behind the front; 0: none that paths keep account of.
#define ROW_MEDIUM 24u
// From this bit of a light's kind on, the number of the texture that it shines as, plus 1; 0: none.
#define LIGHT_TEXTURE 8u

typedef struct {
    SCENE_ARRAYS(SCENE_MEMBER_)
    Bvh bvh, masked;
#ifdef SPECTRAL
    Wavelengths wavelengths;     // at which colors are read: spectral/color.h
#endif
#ifdef PATH_GUIDED
    Field field;
#endif
} Scene;

#ifdef HOLES
#define SCENE_HOLES(scene)                                                                                                  \
    scene.bvh.hole_rows = 0;                                                                                                \
    scene.masked.hole_rows = scene_has(&scene, HAS_HOLES) ? hole_rows : 0;                                                  \
    scene.bvh.attribute_rows = scene.masked.attribute_rows = attribute_rows
#else
#define SCENE_HOLES(scene)
#endif

#ifdef CURVES
#define SCENE_CURVES(scene) scene.bvh.curve_rows = scene.masked.curve_rows = curve_rows
#else
#define SCENE_CURVES(scene)
#endif

#if defined(INSTANCES) && defined(MOTION)
#define SCENE_MOTION(scene)                                                                                                 \
    scene.bvh.motion_rows = scene.masked.motion_rows = motion_rows;                                                         \
    scene.bvh.instance_motions = scene.masked.instance_motions = instance_motions
#else
#define SCENE_MOTION(scene)
#endif

#ifdef INSTANCES
#define SCENE_INSTANCES(scene)                                                                                              \
    SCENE_MOTION(scene);                                                                                                    \
    scene.bvh.instance_rows = scene.masked.instance_rows = instance_rows;                                                   \
    scene.bvh.instance_root = INSTANCE_ROW_ROOT;                                                                            \
    scene.masked.instance_root = INSTANCE_ROW_MASKED_ROOT
#else
#define SCENE_INSTANCES(scene)
#endif

// First in a kernel's parameters, and first in its body.
#define SCENE_PARAMETERS SCENE_ARRAYS(SCENE_PARAMETER_)
#define SCENE_COLLECT(scene)                                                                                                \
    Scene scene;                                                                                                            \
    SCENE_ARRAYS(SCENE_COPY_)                                                                                               \
    scene.bvh.nodes = nodes;                                                                                                \
    scene.bvh.triangle_packs = triangle_packs;                                                                              \
    scene.bvh.analytic_packs = analytic_packs;                                                                              \
    scene.bvh.root = 0;                                                                                                     \
    scene.masked.nodes = masked_nodes;                                                                                      \
    scene.masked.triangle_packs = masked_triangle_packs;                                                                    \
    scene.masked.analytic_packs = masked_analytic_packs;                                                                    \
    scene.masked.root = 0;                                                                                                  \
    SCENE_CURVES(scene);                                                                                                    \
    SCENE_HOLES(scene);                                                                                                     \
    SCENE_INSTANCES(scene)

// The guiding field, where a kernel has one.
#define SCENE_FIELD(scene, its_nodes, its_cells, its_frame)                                                                 \
    scene.field.nodes = its_nodes;                                                                                          \
    scene.field.cells = its_cells;                                                                                          \
    scene.field.frame = its_frame

// Whether the scene has a feature HAS_* that this program is compiled for. A program for any scene (-D UNIVERSAL) asks; else it has.
static int scene_has(const Scene* scene, uint feature) {
#ifdef UNIVERSAL
    return (scene->settings->has & feature) != 0u;
#else
    return 1;
#endif
}

// With one lane: what depends on the settings alone is computed again on each turn of a loop, instead of once before it. It would take a
// register each for the whole loop, and registers are what limits how many work-items a GPU runs at a time. So the address of the settings
// seems to change with a number that is never NONE.
#if LANES == 1
static void scene_settings_again(Scene* scene, uint number) { scene->settings += number == NONE; }
#else
#define scene_settings_again(scene, number)
#endif

#endif
