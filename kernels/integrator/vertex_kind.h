// What is to be done where a path has arrived, as a number: paths with the same number do it side by side.
#ifndef INTEGRATOR_VERTEX_KIND_H
#define INTEGRATOR_VERTEX_KIND_H

#include "geometry/instance.h"
#include "medium/homogeneous.h"
#include "scene.h"

#define VERTEX_KINDS 17u
#define VERTEX_TEXTURED 8u       // beside MATERIAL_*
#define VERTEX_OUTSIDE 7u        // the ray left the scene
#define VERTEX_NONE 15u          // there is no path
#define VERTEX_MEDIUM 16u        // it scatters before it meets anything

// What is to be done at the vertex of each lane.
static vuint vertex_kind(const Scene* scene, vmask alive, Hit hit) {
    const vmask in_medium = alive & medium_scatters(hit), found = alive & !in_medium & (hit.primitive != NONE);
    const vuint row = placed_at(scene, found ? hit.primitive : splat_uint(0u), splat(0.0f)).row * 16u;
    const vuint kind_and_flags = vfloat_bits(lane_gather(scene->primitive_rows, row + PRIMITIVE_ROW_KIND));
    vuint kind = kind_and_flags & ((1u << ROW_FLAGS) - 1u);
#ifdef MATERIALS
    const vmask by_row = found & (kind == MATERIAL_BY_ROW);
    const vuint material = vfloat_bits(lane_gather(scene->primitive_rows, row + PRIMITIVE_ROW_MATERIAL));
    kind = by_row ? vfloat_bits(lane_gather(scene->material_rows, (by_row ? material : splat_uint(0u)) * 32u + MATERIAL_ROW_KIND)) : kind;
#endif
    kind = (kind_and_flags & (SHAPE_TEXTURED << ROW_FLAGS)) != 0u ? kind | VERTEX_TEXTURED : kind;
    return in_medium ? splat_uint(VERTEX_MEDIUM) : found ? kind : alive ? splat_uint(VERTEX_OUTSIDE) : splat_uint(VERTEX_NONE);
}

#endif
