// How much of a surface is there at a point: its opacity, from 0, a hole, to 1.
//
// Opacity is the probability that a ray meets the surface. So it scales all that the surface does: what it reflects, passes and sends out
// (glTF 2.0, 3.9.4, "Alpha Coverage"). Textures are read with all texels around the point: shadow rays then have no noise of them.
//
// Built only where a scene has surfaces with holes (-D OPACITY); such a program knows textures and rows of materials, too.
#ifndef GEOMETRY_OPACITY_H
#define GEOMETRY_OPACITY_H

#ifdef OPACITY

#include "geometry/surface.h"
#include "texture/parameter.h"

// Of the material of these rows; of materials without rows 1.
static vfloat opacity_of(const Scene* scene, vmask has_row, vuint material, const Attributes* attributes) {
    vfloat layer[16];
    const vuint of = has_row ? material : splat_uint(0u);    // what has none may have a colour in the place of the number
    lane_rows(scene->material_rows, of * 2u + 1u, layer);
    const vfloat number = has_row ? layer[LAYER_ROW_OPACITY] : splat(1.0f);
    const TextureSlots slots = parameter_slots(scene, attributes, of);
    const vmask textured = has_row & parameter_textured(attributes, &slots, TEXTURE_OPACITY);
    if (!lane_any(textured)) return number;
    const vfloat value = parameter_number(scene, attributes, &slots, TEXTURE_OPACITY, number);
    const vfloat cut = value >= number ? splat(1.0f) : splat(0.0f);
    return textured ? (number > 0.0f ? cut : value) : number;
}

// At a point that was found.
static vfloat opacity_at(const Scene* scene, const Surface* s, vmask asked) {
    return opacity_of(scene, asked & (s->kind == MATERIAL_BY_ROW), vfloat_bits(s->color.x), &s->attributes);
}

#endif

#endif
