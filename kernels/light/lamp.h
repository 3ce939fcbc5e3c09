// Lights at a point: those that shine alike in all directions, and lamps, which do not: spots, and what IES files say. Lamps are
// built only where a scene has some (-D LAMPS).
//
// A spot's intensity falls off between two cones as a smooth step in the cosine (PBR 4ed, 12.2.2). That of an IES file is linear in both
// of its angles between the numbers of the file.
//
// share: of the largest intensity, in a direction. sample: a direction for a photon, about in proportion to the intensity, and its
// density, per steradian. It is above 0 wherever the lamp shines.
#ifndef LIGHT_LAMP_H
#define LIGHT_LAMP_H

#include "core/frame.h"
#include "core/search.h"
#include "core/warp.h"
#include "light/row.h"

#ifdef LAMPS

static vmask lamp_at_point(const LightRow* l) { return (l->kind == LIGHT_POINT) | (l->kind == LIGHT_SPOT) | (l->kind == LIGHT_IES); }

static vfloat lamp_spot_share(const LightRow* l, vec3 direction) {
    const vec3 off_axis = sub(direction, vec3_row(l->row, LIGHT_ROW_AXIS));
    const vfloat drop = inner(off_axis, off_axis) * 0.5f;            // 1 - cosine, with all its digits near the axis
    const vfloat t = bounded((l->row[LIGHT_ROW_SPREAD] - drop) * l->row[LIGHT_ROW_STEEPNESS], 0.0f, 1.0f);
    return t * t * fma(t, splat(-2.0f), splat(3.0f));
}

static vec3 lamp_spot_sample(const LightRow* l, vfloat u, vfloat v, vfloat* pdf) {
    const vfloat spread = l->row[LIGHT_ROW_SPREAD];
    *pdf = warp_cone_pdf(spread > 0.0f ? spread : splat(1.0f));
    return frame_to_world(frame_around(vec3_row(l->row, LIGHT_ROW_AXIS)), warp_cone(u, v, spread));
}

// The table of an IES file, LAMP_ROW_* of types.h; `clrender/flatten/lamp_tables.py` writes it. Lanes of other lights take the first words for one of
// two lines and columns: these may be the table of the sun, whose numbers would lead anywhere.
typedef struct {
    Frame frame;                     // the middle of its light, horizontal angle 0, and 90
    vuint last_line, last_column;    // below which angles lie
    vuint columns;
    vuint polar, azimuth, value, drop, band, cell;
} LampTable;

static LampTable lamp_table(const Scene* scene, const LightRow* l, vmask where) {
    vfloat head[16];
    lane_rows(scene->lamp_tables, where ? vfloat_bits(l->row[LIGHT_ROW_TABLE]) : splat_uint(0u), head);
    LampTable t;
    t.frame.normal = vec3_row(l->row, LIGHT_ROW_AXIS);
    t.frame.tangent = vec3_row(l->row, LIGHT_ROW_ZERO);
    t.frame.bitangent = outer(t.frame.tangent, t.frame.normal);      // counter-clockwise as seen against the axis
    const vuint two = splat_uint(2u), begin = splat_uint(0u);
    t.columns = where ? vfloat_bits(head[LAMP_ROW_COLUMNS]) : two;
    t.last_line = (where ? vfloat_bits(head[LAMP_ROW_LINES]) : two) - 2u;
    t.last_column = t.columns - 2u;
    t.polar = where ? vfloat_bits(head[LAMP_ROW_POLAR]) : begin, t.azimuth = where ? vfloat_bits(head[LAMP_ROW_AZIMUTH]) : begin;
    t.value = where ? vfloat_bits(head[LAMP_ROW_VALUE]) : begin, t.drop = where ? vfloat_bits(head[LAMP_ROW_DROP]) : begin;
    t.band = where ? vfloat_bits(head[LAMP_ROW_BAND]) : begin, t.cell = where ? vfloat_bits(head[LAMP_ROW_CELL]) : begin;
    return t;
}

static vfloat lamp_between(vfloat a, vfloat b, vfloat share) { return fma(b, share, a * (splat(1.0f) - share)); }

// Two neighbours in the tables.
typedef struct {
    vfloat first, second;
} LampPair;

static LampPair lamp_pair(const Scene* scene, vuint at) {
    LampPair p;
    p.first = lane_gather(scene->lamp_tables, at), p.second = lane_gather(scene->lamp_tables, at + 1u);
    return p;
}

// How far from the first to the second of two numbers another one lies: 0 to 1.
static vfloat lamp_part(LampPair p, vfloat at) { return bounded(quotient(at - p.first, p.second - p.first), 0.0f, 1.0f); }

static vfloat lamp_ies_share(const Scene* scene, const LightRow* l, vec3 direction, vmask where) {
    const LampTable t = lamp_table(scene, l, where);
    const vec3 seen = frame_to_local(t.frame, direction);
    const vfloat polar = turn_of(seen.z, root(fma(seen.x, seen.x, seen.y * seen.y)));
    const vfloat azimuth = turn_of(seen.x, seen.y);
    const vuint line = search_last(scene->lamp_tables, t.polar, 1u, polar, splat_uint(0u), t.last_line);
    const vuint column = search_last(scene->lamp_tables, t.azimuth, 1u, azimuth, splat_uint(0u), t.last_column);
    const LampPair lines = lamp_pair(scene, t.polar + line);
    const vfloat down = lamp_part(lines, polar), right = lamp_part(lamp_pair(scene, t.azimuth + column), azimuth);
    const vuint at = t.value + line * t.columns + column;
    const LampPair upper = lamp_pair(scene, at), lower = lamp_pair(scene, at + t.columns);
    const vfloat share = lamp_between(lamp_between(upper.first, upper.second, right), lamp_between(lower.first, lower.second, right), down);
    return (polar >= lines.first) & (polar <= lines.second) ? share : splat(0.0f);
}

// Choose two neighbouring vertical angles by the light between them, then two horizontal ones, and a direction between those, uniformly.
static vec3 lamp_ies_sample(const Scene* scene, const LightRow* l, vfloat u, vfloat v, vmask where, vfloat* pdf) {
    const LampTable t = lamp_table(scene, l, where);
    const vuint line = search_last(scene->lamp_tables, t.band, 1u, u, splat_uint(0u), t.last_line);
    const vuint cells = t.cell + line * t.columns;
    const vuint column = search_last(scene->lamp_tables, cells, 1u, v, splat_uint(0u), t.last_column);
    const LampPair band = lamp_pair(scene, t.band + line), cell = lamp_pair(scene, cells + column);
    const LampPair drops = lamp_pair(scene, t.drop + line), turns = lamp_pair(scene, t.azimuth + column);
    const vfloat drop = lamp_between(drops.first, drops.second, lamp_part(band, u));
    const vfloat turn = lamp_between(turns.first, turns.second, lamp_part(cell, v));
    vfloat c, s;
    cos_sin_turn(turn < 1.0f ? turn : splat(0.0f), &c, &s);
    const vfloat across = root(drop * (splat(2.0f) - drop));
    *pdf = quotient((band.second - band.first) * (cell.second - cell.first) * (0.5f * INV_PI), (drops.second - drops.first) * (turns.second - turns.first));
    return frame_to_world(t.frame, vec3_of(across * c, across * s, splat(1.0f) - drop));
}

// What a light at a point sends into a direction, W/sr; of other lights, their radiance.
static vec3 lamp_intensity(const Scene* scene, const LightRow* l, vec3 direction) {
    const vmask spot = l->kind == LIGHT_SPOT, ies = l->kind == LIGHT_IES;
    vec3 intensity = l->radiance;
    if (lane_any(spot)) intensity = choose(spot, scale(intensity, lamp_spot_share(l, direction)), intensity);
    if (lane_any(ies)) intensity = choose(ies, scale(intensity, lamp_ies_share(scene, l, direction, ies)), intensity);
    return intensity;
}

// A direction for a photon of a lamp, and its density.
static vec3 lamp_sample(const Scene* scene, const LightRow* l, vfloat u, vfloat v, vmask spot, vmask ies, vfloat* pdf) {
    vec3 direction = lamp_spot_sample(l, u, v, pdf);
    if (lane_any(ies)) {
        vfloat ies_pdf;
        direction = choose(ies, lamp_ies_sample(scene, l, u, v, ies, &ies_pdf), direction);
        *pdf = ies ? ies_pdf : *pdf;
    }
    return direction_again(direction);
}

#else

static vmask lamp_at_point(const LightRow* l) { return l->kind == LIGHT_POINT; }
static vec3 lamp_intensity(const Scene* scene, const LightRow* l, vec3 direction) { return l->radiance; }

#endif
#endif
