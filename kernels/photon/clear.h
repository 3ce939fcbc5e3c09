// Surfaces behind which photons arrive: what is behind glass is as near as what is before it.
#ifndef PHOTON_CLEAR_H
#define PHOTON_CLEAR_H

#include "geometry/surface.h"
#include "material/parameters.h"
#include "types.h"

// Below a point of a disk, or on the way to one of a ball, so many surfaces are looked at.
#define CLEAR_MOST_SURFACES 8u

// Whether light may get through a surface to what lies behind it.
static vmask surface_is_clear(const Scene* scene, const Surface* s) {
    vmask clear = (s->kind == MATERIAL_DIELECTRIC) | (s->kind == MATERIAL_SUBSURFACE);
#ifdef MATERIALS
    const vmask has_row = s->kind == MATERIAL_BY_ROW;
    if (!lane_any(has_row)) return clear;
    vuint row = has_row ? vfloat_bits(s->color.x) : splat_uint(0u);
    vfloat numbers[16];
    lane_rows(scene->material_rows, row * 2u, numbers);
    parameters_unmix(scene, s, has_row, &row, numbers);
    const vuint kind = vfloat_bits(numbers[MATERIAL_ROW_KIND]);
    const vfloat back = lane_gather(scene->material_rows, row * 32u + (16u + LAYER_ROW_DIFFUSE_TRANSMISSION));
    const vmask principled = (numbers[MATERIAL_ROW_TRANSMISSION] > 0.0f) | (back > 0.0f);
    const vmask other = (kind == MATERIAL_DIELECTRIC) | (kind == MATERIAL_SUBSURFACE) | (kind == MATERIAL_PLUGIN);
    clear = has_row ? kind == MATERIAL_PRINCIPLED ? principled : other : clear;
#endif
    return clear;
}

#endif
