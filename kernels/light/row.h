// The row of a light, and what every kind of light has in it.
#ifndef LIGHT_ROW_H
#define LIGHT_ROW_H

#include "core/lane.h"
#include "scene.h"

typedef struct {
    vfloat row[16];      // types.h, LIGHT_ROW_*
    vec3 radiance;       // of a light that shines as a texture, the mean
    vuint kind, primitive;
#ifdef EMISSION_TEXTURES
    vuint texture;       // its number, plus 1; 0: the light is the same all over
#endif
} LightRow;

static LightRow light_at(const Scene* scene, vuint light) {
    LightRow l;
    lane_rows(scene->light_rows, light, l.row);
    l.radiance = vec3_row(l.row, LIGHT_ROW_RADIANCE);
    l.kind = vfloat_bits(l.row[LIGHT_ROW_KIND]);
    l.primitive = vfloat_bits(l.row[LIGHT_ROW_PRIMITIVE]);
#ifdef EMISSION_TEXTURES
    l.texture = l.kind >> LIGHT_TEXTURE;
    l.kind = l.kind & ((1u << LIGHT_TEXTURE) - 1u);
#endif
    return l;
}

#endif
