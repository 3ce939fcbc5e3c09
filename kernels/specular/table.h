// What specular chains can go over, and to which lights: `chain_table`, which clrender/flatten/chains.py writes. Words:
//
//     head      CHAIN_HEAD_ROW_*
//     [lights]  of every light of the scene the probability with which it is chosen; 0: chains do not find it
//     [4 each]  of those that they find: its number, the threshold and alias of its entry (Vose 1991), 0
//     [4 each]  of surfaces that may be deltas: the primitive, threshold and alias, 0
#ifndef SPECULAR_TABLE_H
#define SPECULAR_TABLE_H

#include "core/frame.h"
#include "core/sampler.h"
#include "core/warp.h"
#include "photon/emit.h"
#include "scene.h"

static uint chain_head(const Scene* scene, uint column) { return as_uint(scene->chain_table[column]); }

// How often chains lead to this light.
static vfloat chain_chooses(const Scene* scene, vuint light, vmask where) {
    const vfloat probability = lane_gather(scene->chain_table, CHAIN_HEAD + (where ? light : splat_uint(0u)));
    return where ? probability : splat(0.0f);
}

// An entry of one of the two lists.
static vuint chain_entry(const Scene* scene, uint first, uint count, vuint bits, vuint digits) {
    vuint rest;
    const vuint entry = sampler_pick(bits, count, digits, &rest), at = entry * 4u + first;
    const vuint alias = vfloat_bits(lane_gather(scene->chain_table, at + 2u));
    return (unit_interval(rest) < lane_gather(scene->chain_table, at + 1u) ? entry : alias) * 4u + first;
}

// A point of a light, or a direction from which it shines.
typedef struct {
    LightRow light;
    vec3 point;              // or the unit direction to it
    vec3 normal, error;      // of a surface
    vec3 radiance;           // of a point, 1: it depends on the direction; directional: irradiance
    vfloat pdf;              // with the choice of the light: of a surface per square metre, of the sun per steradian
    vmask surface, point_like, infinite;
} ChainEnd;

static ChainEnd chain_end(const Scene* scene, Sampler sampler, vuint set, vuint choice, vuint set_of_digits, vfloat time) {
    vuint bits, digits;
    vfloat u, v;
    sampler_hash_bits(sampler, set_of_digits, &digits, &bits);
    const uint lights = chain_head(scene, CHAIN_HEAD_ROW_LIGHTS);
    const vuint at = chain_entry(scene, CHAIN_HEAD + chain_head(scene, CHAIN_HEAD_ROW_ALL_LIGHTS), lights, choice, digits);
    sampler_bits(sampler, set, &bits, &digits);
    u = unit_interval(bits), v = unit_interval(digits);
    ChainEnd e;
    const vuint light = vfloat_bits(lane_gather(scene->chain_table, at));
    e.light = light_at(scene, light, time);
    e.pdf = chain_chooses(scene, light, mask_all());
    const LightRow* l = &e.light;
    const vmask triangle = l->kind == LIGHT_AREA_TRIANGLE, sphere = l->kind == LIGHT_AREA_SPHERE, disk = l->kind == LIGHT_AREA_DISK;
    const vmask sun = sun_is(l), directional = l->kind == LIGHT_DIRECTIONAL, round_ = sphere | disk;
    const vec3 position = vec3_row(l->row, LIGHT_ROW_POSITION);
    EmissionPoint from = emission_triangle(l, u, v);
    if (lane_any(round_)) {
        const EmissionPoint round_point = emission_round(l, sphere, u, v);
        from.point = choose(round_, round_point.point, from.point);
        from.normal = choose(round_, round_point.normal, from.normal);
        from.error = choose(round_, round_point.error, from.error);
        from.area = round_ ? round_point.area : from.area;
    }
    e.surface = triangle | round_;
    e.infinite = directional | sun;
    e.point_like = !(e.surface | e.infinite);
    e.point = choose(e.surface, from.point, choose(e.infinite, negate(position), position));
    e.normal = from.normal;
    e.error = from.error;
    e.pdf = e.surface ? quotient(e.pdf, e.surface ? from.area : splat(1.0f)) : e.pdf;
    e.radiance = choose(e.surface, emission_sampled(scene, l, from.point, from.normal, u, v, e.surface), choose(e.point_like, vec3_all(1.0f), l->radiance));
#ifdef SUN
    if (lane_any(sun)) {
        const EnvironmentSample disc = sun_sample(scene, u, v);
        e.point = choose(sun, disc.direction, e.point);
        e.radiance = choose(sun, disc.radiance, e.radiance);
        e.pdf = sun ? e.pdf * disc.pdf : e.pdf;
    }
#endif
    return e;
}

// A point of a surface that may be a delta.
static vec3 chain_place(const Scene* scene, vuint bits, vuint digits, vfloat u, vfloat v, vfloat time) {
    const uint first = chain_head(scene, CHAIN_HEAD_ROW_FIRST_SURFACE);
    const vuint at = chain_entry(scene, first, chain_head(scene, CHAIN_HEAD_ROW_SURFACES), bits, digits);
    const Placed placed = placed_at(scene, vfloat_bits(lane_gather(scene->chain_table, at)), time);
    const vmask is_round = placed.row >= scene->settings->triangle_count;
    vfloat row[16];
    lane_rows(scene->primitive_rows, placed.row, row);
    placed_geometry(&placed, is_round, row);
    const vec3 a = vec3_row(row, PRIMITIVE_ROW_A);
    vfloat b, c;
    warp_triangle(u, v, &b, &c);
    const vec3 flat = along(along(a, sub(vec3_row(row, PRIMITIVE_ROW_B), a), b), sub(vec3_row(row, PRIMITIVE_ROW_C), a), c);
    if (!lane_any(is_round)) return flat;
    const vec3 normal = vec3_row(row, PRIMITIVE_ROW_NORMAL);
    const vmask disk = (normal.x != 0.0f) | (normal.y != 0.0f) | (normal.z != 0.0f);
    vfloat x, y;
    warp_disk(u, v, &x, &y);
    const Frame f = frame_around(choose(disk, normal, vec3_of(splat(0.0f), splat(0.0f), splat(1.0f))));
    const vec3 out = choose(disk, along(scale(f.tangent, x), f.bitangent, y), warp_sphere(u, v));
    return choose(is_round, along(a, out, row[PRIMITIVE_ROW_RADIUS]), flat);
}

#endif
