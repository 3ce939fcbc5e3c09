// Normal maps and bump maps: the shading normal that they make of a surface's own.
#ifndef TEXTURE_NORMAL_MAP_H
#define TEXTURE_NORMAL_MAP_H

#include "core/bent.h"
#include "core/exact.h"
#include "core/frame.h"
#include "texture/parameter.h"

// Of a map whose red and green differ from their middle by less, the normal stays what it is, to the bit.
#define NORMAL_MAP_FLAT 4.0e-6f

#ifdef TANGENTS
// The tangent at the point, interpolated and of any length, and on which side of it green lies; where the triangle has tangents.
static vmask normal_map_tangent(const Scene* scene, const Attributes* a, vmask asked, vec3* tangent, vfloat* sign) {
    const vuint row = vfloat_bits(a->row[ATTRIBUTE_ROW_TANGENTS]);
    const vmask given = asked & a->textured & (row != 0u);
    if (!lane_any(given)) return given;
    vfloat corners[16];
    lane_rows(scene->attribute_rows, given ? row : splat_uint(0u), corners);
    const vfloat weight_a = splat(1.0f) - a->weight_b - a->weight_c;
    const vec3 at_a = scale(vec3_row(corners, TANGENT_ROW_A), weight_a), at_b = vec3_row(corners, TANGENT_ROW_B);
    *tangent = along(along(at_a, at_b, a->weight_b), vec3_row(corners, TANGENT_ROW_C), a->weight_c);
    *sign = corners[TANGENT_ROW_SIGN];
#ifdef INSTANCES
    *tangent = placed_tangent(&a->placed, *tangent, sign);
#endif
    return given & (inner(*tangent, *tangent) > 1.0e-12f);
}
#endif

// From derivatives of the point by texture coordinates to those by the picture's own, to the right and up, whose sizes say nothing: the texture's
// transform turns and mirrors the slopes of a map as it does its picture.
static void normal_map_turned(const Texture* t, vec3* along_u, vec3* along_v) {
    const vfloat a = t->row[TEXTURE_ROW_U], b = t->row[TEXTURE_ROW_U + 1], c = t->row[TEXTURE_ROW_V], d = t->row[TEXTURE_ROW_V + 1];
    const vfloat sign = a * d - b * c < 0.0f ? splat(-1.0f) : splat(1.0f);
    const vec3 right = sub(scale(*along_u, d), scale(*along_v, c)), up = sub(scale(*along_u, b), scale(*along_v, a));
    *along_u = scale(right, sign), *along_v = scale(up, sign);
}

// The normal that a normal map shows, around `normal`: red to the picture's right, or along a tangent that is given, green up, blue outward.
static vec3 normal_map_normal(const Scene* scene, const Attributes* a, vuint texture, vmask has, vec3 normal, vmask* tilted) {
    const Texture t = texture_at(scene, has ? texture : splat_uint(0u));
    vfloat x, y;
    parameter_place(a, &t, &x, &y);
    const Texel value = filter_value(scene, &t, x, y, a->taps, has);
    const vfloat spread = t.row[TEXTURE_ROW_FACTOR], bias = t.row[TEXTURE_ROW_BIAS], strength = t.row[TEXTURE_ROW_FACTOR + 2];
    const vfloat red = fma(value.r, spread, bias), green = fma(value.g, spread, bias), blue = fma(value.b, spread, bias);
    *tilted = has & ((absolute(red) > NORMAL_MAP_FLAT) | (absolute(green) > NORMAL_MAP_FLAT));
    vec3 along_u, along_v;
    mapping_tangents(a, (t.format >> 14) & 1u, &along_u, &along_v);
    normal_map_turned(&t, &along_u, &along_v);
#ifdef TANGENTS
    vec3 tangent_there = along_u;
    vfloat side = splat(1.0f);
    const vmask given = normal_map_tangent(scene, a, has, &tangent_there, &side);
    along_u = choose(given, tangent_there, along_u);
    along_v = choose(given, scale(outer(normal, tangent_there), side), along_v);
#endif
    const vec3 level = sub(along_u, scale(normal, inner(along_u, normal)));
    const vmask sound = (inner(level, level) > 0.0f) & (inner(along_u, along_u) > 0.0f);
    const vec3 tangent = choose(sound, unit(level), frame_around(normal).tangent);
    const vec3 across = outer(normal, tangent);
    const vec3 bitangent = choose(sound & (inner(across, along_v) < 0.0f), negate(across), across);
    const vec3 to = along(along(scale(normal, greater(blue, splat(1.0e-4f))), bitangent, green * strength), tangent, red * strength);
    return choose(*tilted, unit(to), normal);
}

// The slope of the heights at the point, over the texture's coordinates; the derivative of what linear interpolation gives.
static void normal_map_slope(const Scene* scene, const Attributes* a, const Texture* t, vmask has, vfloat* slope_u, vfloat* slope_v) {
    vfloat x, y;
    parameter_place(a, t, &x, &y);
    const vfloat width = vfloat_of(vint_from_uint(t->width)), height = vfloat_of(vint_from_uint(t->height));
    const vuint wrap_u = filter_wrap_u(t), wrap_v = filter_wrap_v(t);
    const Quartet q = filter_quartet(t, filter_fold(x, wrap_u) * width, filter_fold(y, wrap_v) * height);
    vfloat h[4];
    for (int k = 0; k < 4; ++k) h[k] = parameter_channel(t, texel_load(scene, t, q.x[k & 1], q.y[k >> 1], has));
    const vfloat top = h[1] - h[0], bottom = h[3] - h[2], left = h[2] - h[0], right = h[3] - h[1];
    vfloat by_x = fma(q.share_y, bottom - top, top) * width, by_y = fma(q.share_x, right - left, left) * height;
    // A mirrored picture runs backwards in every other turn
    const vmask back_x = (wrap_u == WRAP_MIRROR) & (x - floor(x * 0.5f) * 2.0f > 1.0f);
    const vmask back_y = (wrap_v == WRAP_MIRROR) & (y - floor(y * 0.5f) * 2.0f > 1.0f);
    by_x = (back_x ? -by_x : by_x) * t->row[TEXTURE_ROW_FACTOR];
    by_y = (back_y ? -by_y : by_y) * t->row[TEXTURE_ROW_FACTOR];
    *slope_u = fma(by_x, t->row[TEXTURE_ROW_U], by_y * t->row[TEXTURE_ROW_V]);
    *slope_v = fma(by_x, t->row[TEXTURE_ROW_U + 1], by_y * t->row[TEXTURE_ROW_V + 1]);
}

// The normal of a surface whose points are moved along `normal` by the heights of a bump map (Blinn 1978): n − ∇h.
static vec3 normal_map_bumped(const Scene* scene, const Attributes* a, vuint texture, vmask has, vec3 normal, vmask* tilted) {
    const Texture t = texture_at(scene, has ? texture : splat_uint(0u));
    vfloat slope_u, slope_v;
    normal_map_slope(scene, a, &t, has, &slope_u, &slope_v);
    vec3 along_u, along_v;
    mapping_tangents(a, (t.format >> 14) & 1u, &along_u, &along_v);
    const vfloat area = inner(normal, outer(along_u, along_v));
    const vmask moves = has & (absolute(area) > 1.0e-30f) & ((slope_u != 0.0f) | (slope_v != 0.0f));
    const vec3 sum = along(scale(outer(normal, along_u), slope_v), outer(along_v, normal), slope_u);
    const vec3 gradient = scale(sum, quotient(splat(1.0f), moves ? area : splat(1.0f)));
    *tilted = *tilted | moves;
    return choose(moves, unit(sub(normal, gradient)), normal);
}

// The shading normal of each lane, on the front side as `shading` is, seen against the unit `direction` of the ray.
__attribute__((noinline)) static vec3 normal_map_shading(const Scene* scene, const Attributes* a, const TextureSlots* slots, vec3 normal,
                                                         vec3 shading, vmask front, vec3 direction) {
    const vmask mapped = parameter_textured(a, slots, TEXTURE_NORMAL), bumped = parameter_textured(a, slots, TEXTURE_BUMP);
    if (!lane_any(mapped | bumped)) return shading;
    vmask tilted = mask_none();
    vec3 turned = shading;
    if (lane_any(mapped)) turned = normal_map_normal(scene, a, vfloat_bits(slots->texture[TEXTURE_NORMAL]), mapped, turned, &tilted);
    if (lane_any(bumped)) turned = normal_map_bumped(scene, a, vfloat_bits(slots->texture[TEXTURE_BUMP]), bumped, turned, &tilted);
    const vec3 bent = bent_normal(choose(front, turned, negate(turned)), choose(front, normal, negate(normal)), negate(direction));
    return choose(tilted, choose(front, bent, negate(bent)), shading);
}

#endif
