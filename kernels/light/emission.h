// The radiance that a surface sends out by itself, where it may be a texture. Built only where a scene has such lights
// (-D EMISSION_TEXTURES): elsewhere it is what the light's row says.
//
// The choice of a light goes by its mean radiance and its points are all as likely, so no density depends on the texture.
#ifndef LIGHT_EMISSION_H
#define LIGHT_EMISSION_H

#include "core/warp.h"
#include "geometry/opacity.h"
#include "geometry/surface.h"
#include "light/row.h"
#ifdef EMISSION_TEXTURES
#include "texture/parameter.h"

static vec3 emission_at(const Scene* scene, const LightRow* l, const Attributes* a, vmask where) {
    const vmask textured = where & (l->texture != 0u);
    return lane_any(textured) ? choose(textured, color_light(scene, parameter_texture(scene, a, l->texture - 1u, textured)), l->radiance) : l->radiance;
}
#endif

// At a surface that was found, and is the light `l` where it `shines`.
static vec3 emission_found(const Scene* scene, const LightRow* l, const Surface* s, vmask shines) {
#ifdef EMISSION_TEXTURES
    return emission_at(scene, l, &s->attributes, shines);
#else
    return l->radiance;
#endif
}

#ifdef TEXTURES
// What textures need to know of the point of the light that u and v stand for; `normal` is that of its front.
static Attributes emission_attributes(const Scene* scene, const LightRow* l, vec3 point, vec3 normal, vfloat u, vfloat v, vmask textured) {
    const vfloat radius = l->row[LIGHT_ROW_RADIUS];
    const Placed placed = light_placed(scene, l, textured);
    Attributes a = mapping_attributes(scene, placed.row, textured);
    placed_axes(&placed, l->kind != LIGHT_AREA_TRIANGLE, a.row);
    a.sphere = l->kind == LIGHT_AREA_SPHERE, a.disk = l->kind == LIGHT_AREA_DISK;
    a.ab = a.ac = vec3_all(0.0f);
    a.radius = radius;
    warp_triangle(u, v, &a.weight_b, &a.weight_c);
    const vec3 from_center = scale(sub(point, vec3_row(l->row, LIGHT_ROW_CENTER)), inverse_or_one(radius));
    a.out = choose(a.sphere, scale(normal, l->row[LIGHT_ROW_FACING]), from_center);
    return a;
}
#endif

// At that point.
static vec3 emission_sampled(const Scene* scene, const LightRow* l, vec3 point, vec3 normal, vfloat u, vfloat v, vmask where) {
    vec3 radiance = l->radiance;
#ifdef EMISSION_TEXTURES
    const vmask textured = where & (l->texture != 0u);
    if (lane_any(textured)) {
        const Attributes a = emission_attributes(scene, l, point, normal, u, v, textured);
        radiance = emission_at(scene, l, &a, textured);
    }
#endif
#ifdef OPACITY
    // A hole in a light sends nothing; a ray that finds the light has passed by all holes
    const vmask surface = where & light_is_surface(l);
    vfloat row[16];
    lane_rows(scene->primitive_rows, light_placed(scene, l, surface).row, row);
    const vuint kind_and_flags = vfloat_bits(row[PRIMITIVE_ROW_KIND]), flags = kind_and_flags >> ROW_FLAGS;
    const vmask by_row = (kind_and_flags & ((1u << ROW_FLAGS) - 1u)) == MATERIAL_BY_ROW;
    const vmask masked = surface & by_row & ((flags & SHAPE_MASKED) != 0u);
    if (lane_any(masked)) {
        const vmask has = masked & ((flags & SHAPE_TEXTURED) != 0u);
        const Attributes a = emission_attributes(scene, l, point, normal, u, v, has);
        const vfloat opacity = opacity_of(scene, masked, vfloat_bits(row[PRIMITIVE_ROW_MATERIAL]), &a);
        radiance = choose(masked, scale(radiance, opacity), radiance);
    }
#endif
    return radiance;
}

#endif
