// The row of a light, and what every kind of light has in it.
#ifndef LIGHT_ROW_H
#define LIGHT_ROW_H

#include "core/lane.h"
#include "geometry/instance.h"
#include "plugin/given.h"
#include "scene.h"
#include "spectral/color.h"

typedef struct {
    vfloat row[16];      // types.h, LIGHT_ROW_*
    vec3 radiance;       // of a light that shines as a texture, the mean
    vuint kind, primitive;
#ifdef EMISSION_TEXTURES
    vuint texture;       // its number, plus 1; 0: the light is the same all over
#endif
#ifdef MOTION
    vfloat time;         // when it is where its row says
#endif
} LightRow;

// A surface that shines.
static vmask light_is_surface(const LightRow* l) {
    return (l->kind == LIGHT_AREA_TRIANGLE) | (l->kind == LIGHT_AREA_SPHERE) | (l->kind == LIGHT_AREA_DISK);
}

// Where its surface is, for what textures need.
static Placed light_placed(const Scene* scene, const LightRow* l, vmask where) {
#ifdef MOTION
    const vfloat time = l->time;
#else
    const vfloat time = splat(0.0f);
#endif
    return placed_at(scene, where ? l->primitive : splat_uint(0u), time);
}

#if defined(MOTION) && defined(INSTANCES)
// Lights that are surfaces of instances move: all others are written out. Their rows have them in the space of their group.
static void light_move(const Scene* scene, LightRow* l) {
    const vmask moves = light_is_surface(l) & instance_owns(scene, l->primitive);
    if (!lane_any(moves)) return;
    const Placed placed = light_placed(scene, l, moves);
    const vfloat* m = placed.placement + PLACEMENT_ROW_TO_WORLD;
    const vmask flat = moves & (l->kind == LIGHT_AREA_TRIANGLE), round = moves & !flat;
    vec3_row_put(l->row, LIGHT_ROW_A, choose(moves, placed_point(m, vec3_row(l->row, LIGHT_ROW_A)), vec3_row(l->row, LIGHT_ROW_A)));
    const vec3 ab = vec3_row(l->row, LIGHT_ROW_AB), ac = vec3_row(l->row, LIGHT_ROW_AC);
    const vec3 ab_there = placed_vector(m, ab), ac_there = placed_vector(m, ac), normal = placed_turned(&placed, vec3_row(l->row, LIGHT_ROW_NORMAL));
    const vfloat radius = l->row[LIGHT_ROW_RADIUS] * placed.placement[PLACEMENT_ROW_SCALE], inverse = inverse_magnitude(outer(ab_there, ac_there));
    vec3_row_put(l->row, LIGHT_ROW_AB, choose(flat, ab_there, ab));
    vec3_row_put(l->row, LIGHT_ROW_AC, choose(flat, ac_there, choose(round, normal, ac)));
    l->row[LIGHT_ROW_RADIUS] = round ? radius : l->row[LIGHT_ROW_RADIUS];
    l->row[LIGHT_ROW_INVERSE] = flat ? inverse : l->row[LIGHT_ROW_INVERSE];
}
#else
static void light_move(const Scene* scene, LightRow* l) {}
#endif

#ifdef PLUGIN_LIGHTS
// Lights of plugins have their directions in lamp_tables, for their rows come from a program that knows nothing of them.
static void light_aim(const Scene* scene, LightRow* l) {
    const vmask given = l->kind == LIGHT_PLUGIN;
    if (!lane_any(given)) return;
    const vuint table = vuint_from_int(vint_of(given ? l->row[LIGHT_ROW_GIVEN] : splat(0.0f)));
    vfloat head[16];
    lane_rows(scene->lamp_tables, table, head);
    const vec3 axis = vec3_row(l->row, LIGHT_ROW_AXIS), zero = vec3_row(l->row, LIGHT_ROW_ZERO);
    vec3_row_put(l->row, LIGHT_ROW_AXIS, choose(given, vec3_row(head, GIVEN_ROW_AXIS), axis));
    vec3_row_put(l->row, LIGHT_ROW_ZERO, choose(given, vec3_row(head, GIVEN_ROW_RIGHT), zero));
    l->row[LIGHT_ROW_TABLE] = given ? vfloat_from_bits(table) : l->row[LIGHT_ROW_TABLE];
}
#endif

#ifdef MOVING_LIGHTS
// Lights that are no surfaces and move have their motion in the place of the primitive, and in their rows where they are before it.
static void light_carry(const Scene* scene, LightRow* l, vfloat time) {
    const vmask moves = !light_is_surface(l) & (l->primitive != NONE);
    if (!lane_any(moves)) return;
    const vuint first = moves ? l->primitive : splat_uint(0u), word = first * 16u + MOTION_ROW_SEGMENTS;
    MotionMap map;
    motion_at(scene->motion_rows, first, moves ? vfloat_bits(lane_gather(scene->motion_rows, word)) : splat_uint(0u), time, &map);
    const vec3 place = vec3_row(l->row, LIGHT_ROW_POSITION), turned = motion_turned(map.linear, place);
    const vec3 there = choose(l->kind == LIGHT_DIRECTIONAL, unit(turned), add(turned, motion_offset(&map)));
    vec3_row_put(l->row, LIGHT_ROW_POSITION, choose(moves, there, place));
#ifdef LAMPS
#ifdef PLUGIN_LIGHTS
    const vmask table = moves & ((l->kind == LIGHT_IES) | (l->kind == LIGHT_PROJECTOR) | (l->kind == LIGHT_PLUGIN));
    const vmask aimed = table | (moves & (l->kind == LIGHT_SPOT));
#else
    const vmask table = moves & ((l->kind == LIGHT_IES) | (l->kind == LIGHT_PROJECTOR)), aimed = table | (moves & (l->kind == LIGHT_SPOT));
#endif
    const vec3 axis = vec3_row(l->row, LIGHT_ROW_AXIS), zero = vec3_row(l->row, LIGHT_ROW_ZERO);
    vec3_row_put(l->row, LIGHT_ROW_AXIS, choose(aimed, unit(motion_turned(map.linear, axis)), axis));
    vec3_row_put(l->row, LIGHT_ROW_ZERO, choose(table, unit(motion_turned(map.linear, zero)), zero));
#endif
    l->primitive = moves ? splat_uint(NONE) : l->primitive;
}
#endif

// A light where it is at a time.
static LightRow light_at(const Scene* scene, vuint light, vfloat time) {
    LightRow l;
    lane_rows(scene->light_rows, light, l.row);
    l.radiance = color_light(scene, vec3_row(l.row, LIGHT_ROW_RADIANCE));
    l.kind = vfloat_bits(l.row[LIGHT_ROW_KIND]);
    l.primitive = vfloat_bits(l.row[LIGHT_ROW_PRIMITIVE]);
#ifdef EMISSION_TEXTURES
    l.texture = l.kind >> LIGHT_TEXTURE;
    l.kind = l.kind & ((1u << LIGHT_TEXTURE) - 1u);
#endif
#ifdef MOTION
    l.time = time;
#endif
    light_move(scene, &l);
#ifdef PLUGIN_LIGHTS
    light_aim(scene, &l);
#endif
#ifdef MOVING_LIGHTS
    light_carry(scene, &l, time);
#endif
    return l;
}

#endif
