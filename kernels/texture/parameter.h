// A parameter of a material: a constant, or a texture in its place.
#ifndef TEXTURE_PARAMETER_H
#define TEXTURE_PARAMETER_H

#include "core/exact.h"
#include "texture/filter.h"
#include "texture/mapping.h"
#include "types.h"

// Which texture, if any, stands for each parameter of the lanes' materials: TEXTURE_* of types.h.
typedef struct {
    vfloat texture[16];
} TextureSlots;

// `material`: the number of each lane's material.
static TextureSlots parameter_slots(const Scene* scene, const Attributes* a, vuint material) {
    TextureSlots slots;
    lane_rows(scene->texture_slots, a->textured ? material : splat_uint(0u), slots.texture);
    return slots;
}

static vmask parameter_textured(const Attributes* a, const TextureSlots* slots, uint slot) {
    return a->textured & (vfloat_bits(slots->texture[slot]) != NONE);
}

// Column and row of the picture, from 0 to 1 within it, at the point.
static void parameter_place(const Attributes* a, const Texture* t, vfloat* x, vfloat* y) {
    vfloat u, v;
    mapping_uv(a, (t->format >> 14) & 1u, &u, &v);
    *x = fma(u, t->row[TEXTURE_ROW_U], fma(v, t->row[TEXTURE_ROW_U + 1], t->row[TEXTURE_ROW_U + 2]));
    *y = fma(u, t->row[TEXTURE_ROW_V], fma(v, t->row[TEXTURE_ROW_V + 1], t->row[TEXTURE_ROW_V + 2]));
}

// The one channel that the texture is said to give; luminance is that of linear Rec. 709.
static vfloat parameter_channel(const Texture* t, Texel value) {
    const vuint channel = (t->format >> 11) & 7u;
    const vfloat luminance = fma(value.r, splat(0.2126f), fma(value.g, splat(0.7152f), value.b * 0.0722f));
    const vfloat color = channel == 3u ? value.b : channel == 2u ? value.g : value.r;
    return channel == 5u ? luminance : channel == 4u ? value.a : color;
}

#ifdef PLUGIN_TEXTURES
// The value of a plugin's texture, where `given`.
static vec3 parameter_made(const Scene* scene, const Attributes* a, const Texture* t, vmask given, vfloat x, vfloat y) {
    if (!lane_any(given)) return vec3_all(0.0f);
    vfloat numbers[PLUGIN_NUMBERS];
    lane_rows(scene->texture_rows, given ? vfloat_bits(t->row[TEXTURE_ROW_NUMBERS]) : splat_uint(0u), numbers);
    const vuint plugin = given ? vfloat_bits(t->row[TEXTURE_ROW_PLUGIN]) : splat_uint(0u);
    return plugin_value(plugin, numbers, x, y, add(a->point, vec3_from(scene->camera->world)));
}
#endif

// The texture of each lane at its point; one function of its own, since materials have many parameters.
__attribute__((noinline)) static vec3 parameter_texture(const Scene* scene, const Attributes* a, vuint texture, vmask has) {
    const Texture t = texture_at(scene, has ? texture : splat_uint(0u));
    vfloat x, y;
    parameter_place(a, &t, &x, &y);
#ifdef PLUGIN_TEXTURES
    const vmask given = has & ((t.format & TEXTURE_PLUGIN) != 0u);
    const vec3 made = parameter_made(scene, a, &t, given, x, y);
    const Texel value = filter_value(scene, &t, x, y, a->taps, has & !given);
#else
    const Texel value = filter_value(scene, &t, x, y, a->taps, has);
#endif
    const vfloat one = parameter_channel(&t, value);
    const vec3 color = choose(((t.format >> 11) & 7u) == 0u, vec3_of(value.r, value.g, value.b), vec3_of(one, one, one));
#ifdef PLUGIN_TEXTURES
    return choose(given, made, mul(color, vec3_row(t.row, TEXTURE_ROW_FACTOR)));
#else
    return mul(color, vec3_row(t.row, TEXTURE_ROW_FACTOR));
#endif
}

// The parameter of a slot, from 0 to 1, where its constant is `otherwise`.
static vec3 parameter_color(const Scene* scene, const Attributes* a, const TextureSlots* slots, uint slot, vec3 otherwise) {
    const vmask has = parameter_textured(a, slots, slot);
    if (!lane_any(has)) return otherwise;
    const vec3 c = parameter_texture(scene, a, vfloat_bits(slots->texture[slot]), has);
    return choose(has, vec3_of(bounded(c.x, 0.0f, 1.0f), bounded(c.y, 0.0f, 1.0f), bounded(c.z, 0.0f, 1.0f)), otherwise);
}
static vfloat parameter_number(const Scene* scene, const Attributes* a, const TextureSlots* slots, uint slot, vfloat otherwise) {
    return parameter_color(scene, a, slots, slot, vec3_of(otherwise, otherwise, otherwise)).x;
}

// The base colour: multiplied by the colours of its vertices, interpolated, where the triangle has any (glTF 2.0, 3.7.2.1). A spectrum stays, and
// is to be multiplied by `shade` when it is read.
static vec3 parameter_base_color(const Scene* scene, const Attributes* a, const TextureSlots* slots, vec3 otherwise, vec3* shade) {
    const vec3 color = parameter_color(scene, a, slots, TEXTURE_BASE_COLOR, otherwise);
    const vuint row = vfloat_bits(a->row[ATTRIBUTE_ROW_COLORS]);
    const vmask has = a->textured & (row != 0u);
    if (!lane_any(has)) return color;
    vfloat corners[16];
    lane_rows(scene->attribute_rows, has ? row : splat_uint(0u), corners);
    // Of three equal colours exactly that
    const vec3 at = vec3_row(corners, 0), to_b = sub(vec3_row(corners, 3), at), to_c = sub(vec3_row(corners, 6), at);
    const vec3 c = along(along(at, to_b, a->weight_b), to_c, a->weight_c);
    const vec3 vertices = vec3_of(bounded(c.x, 0.0f, 1.0f), bounded(c.y, 0.0f, 1.0f), bounded(c.z, 0.0f, 1.0f));
#ifdef SPECTRAL
    const vmask spectrum = has & color_is_spectrum(color);
    *shade = choose(spectrum, vertices, *shade);
    return choose(has & !spectrum, mul(color, vertices), color);
#else
    return choose(has, mul(color, vertices), color);
#endif
}

#endif
