// Lights at a point: those that shine alike in all directions, and lamps, which do not: spots, what IES files say, projectors, and what
// plugins say. Lamps are built only where a scene has some (-D LAMPS), and those of plugins likewise (PLUGIN_LIGHTS of plugin/given.h).
//
// A spot's intensity falls off between two cones as a smooth step in the cosine (PBR 4ed, 12.2.2). That of an IES file is linear in both
// of its angles between the numbers of the file. A projector's picture is linear in between the middles of its pixels, on a screen at
// distance 1: its intensity is that of the picture over cos³, which lights such a screen as the picture says, or the picture itself.
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

static vmask lamp_has_table(const LightRow* l) { return (l->kind == LIGHT_IES) | (l->kind == LIGHT_PROJECTOR); }
#ifdef PLUGIN_LIGHTS
static vmask lamp_is_given(const LightRow* l) { return l->kind == LIGHT_PLUGIN; }
static vmask lamp_at_point(const LightRow* l) { return (l->kind == LIGHT_POINT) | (l->kind == LIGHT_SPOT) | lamp_has_table(l) | lamp_is_given(l); }
#else
static vmask lamp_at_point(const LightRow* l) { return (l->kind == LIGHT_POINT) | (l->kind == LIGHT_SPOT) | lamp_has_table(l); }
#endif

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

// The table of an IES file or of a picture, LAMP_ROW_* of types.h; `clrender/flatten/lamp_tables.py` and `projected.py` write it. Lanes of other lights
// take the first words for one of two lines and columns: these may be the table of the sun, whose numbers would lead anywhere.
typedef struct {
    Frame frame;                     // the middle of its light; horizontal angle 0, and 90, or right and up
    vuint last_line, last_column;    // below which the lines and columns that enclose a place lie
    vuint lines, columns;
    vuint line, column, value, drop, band, cell;
    vmask picture, even;
} LampTable;

static LampTable lamp_table(const Scene* scene, const LightRow* l, vmask where) {
    vfloat head[16];
    lane_rows(scene->lamp_tables, where ? vfloat_bits(l->row[LIGHT_ROW_TABLE]) : splat_uint(0u), head);
    LampTable t;
    t.frame.normal = vec3_row(l->row, LIGHT_ROW_AXIS);
    t.frame.tangent = vec3_row(l->row, LIGHT_ROW_ZERO);
    t.frame.bitangent = outer(t.frame.tangent, t.frame.normal);      // counter-clockwise as seen against the axis
    const vuint two = splat_uint(2u), begin = splat_uint(0u);
    t.lines = where ? vfloat_bits(head[LAMP_ROW_LINES]) : two, t.columns = where ? vfloat_bits(head[LAMP_ROW_COLUMNS]) : two;
    t.last_line = t.lines - 2u, t.last_column = t.columns - 2u;
    t.line = where ? vfloat_bits(head[LAMP_ROW_LINE]) : begin, t.column = where ? vfloat_bits(head[LAMP_ROW_COLUMN]) : begin;
    t.value = where ? vfloat_bits(head[LAMP_ROW_VALUE]) : begin, t.drop = where ? vfloat_bits(head[LAMP_ROW_DROP]) : begin;
    t.band = where ? vfloat_bits(head[LAMP_ROW_BAND]) : begin, t.cell = where ? vfloat_bits(head[LAMP_ROW_CELL]) : begin;
    t.picture = where & (l->kind == LIGHT_PROJECTOR), t.even = t.picture & (vfloat_bits(head[LAMP_ROW_EVEN]) != 0u);
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

// The intensities around a place: those of one channel that surround it, linear in between.
static vfloat lamp_within(const Scene* scene, const LampTable* t, vuint at, vfloat right, vfloat up) {
    const LampPair first = lamp_pair(scene, at), second = lamp_pair(scene, at + t->columns);
    return lamp_between(lamp_between(first.first, first.second, right), lamp_between(second.first, second.second, right), up);
}

// 1 / cos³ of a place of a picture, whose screen is at distance 1: what a steradian there covers of the screen, and what lights it evenly.
static vfloat lamp_spread(vfloat x, vfloat y) {
    const vfloat distance2 = fma(x, x, fma(y, y, splat(1.0f)));
    return distance2 * root(distance2);
}

static vec3 lamp_table_share(const Scene* scene, const LightRow* l, vec3 direction, vmask where) {
    const LampTable t = lamp_table(scene, l, where);
    const vec3 seen = frame_to_local(t.frame, direction);
    const vmask ahead = !t.picture | (seen.z > 0.0f);
    const vfloat inverse = inverse_or_one(ahead ? seen.z : splat(1.0f)), x = seen.x * inverse, y = seen.y * inverse;
    const vfloat down = t.picture ? y : turn_of(seen.z, root(fma(seen.x, seen.x, seen.y * seen.y)));
    const vfloat around = t.picture ? x : turn_of(seen.x, seen.y);
    const vuint line = search_last(scene->lamp_tables, t.line, 1u, down, splat_uint(0u), t.last_line);
    const vuint column = search_last(scene->lamp_tables, t.column, 1u, around, splat_uint(0u), t.last_column);
    const LampPair lines = lamp_pair(scene, t.line + line), columns = lamp_pair(scene, t.column + column);
    const vfloat up = lamp_part(lines, down), right = lamp_part(columns, around);
    const vuint at = t.value + line * t.columns + column;
    const vmask within = ahead & (down >= lines.first) & (down <= lines.second);
    const vfloat first = lamp_within(scene, &t, at, right, up);
    vec3 share = vec3_of(first, first, first);
    vmask shines = within;
    if (lane_any(t.picture)) {
        const vuint size = t.picture ? t.lines * t.columns : splat_uint(0u);
        share.y = lamp_within(scene, &t, at + size, right, up), share.z = lamp_within(scene, &t, at + 2u * size, right, up);
        share = scale(color_unbounded(scene, share), t.even ? lamp_spread(x, y) : splat(1.0f));
        shines = within & (!t.picture | ((around >= columns.first) & (around <= columns.second)));
    }
    return choose(shines, share, vec3_all(0.0f));
}

// Choose two neighbouring lines by the light between them, then two columns, and a direction between those: uniformly on a sphere, or on the
// screen of a picture.
static vec3 lamp_table_sample(const Scene* scene, const LightRow* l, vfloat u, vfloat v, vmask where, vfloat* pdf) {
    const LampTable t = lamp_table(scene, l, where);
    const vuint line = search_last(scene->lamp_tables, t.band, 1u, u, splat_uint(0u), t.last_line);
    const vuint cells = t.cell + line * t.columns;
    const vuint column = search_last(scene->lamp_tables, cells, 1u, v, splat_uint(0u), t.last_column);
    const LampPair band = lamp_pair(scene, t.band + line), cell = lamp_pair(scene, cells + column);
    const LampPair downs = lamp_pair(scene, (t.picture ? t.line : t.drop) + line), arounds = lamp_pair(scene, t.column + column);
    const vfloat down = lamp_between(downs.first, downs.second, lamp_part(band, u));
    const vfloat around = lamp_between(arounds.first, arounds.second, lamp_part(cell, v));
    const vfloat light = (band.second - band.first) * (cell.second - cell.first);
    const vfloat density = quotient(t.picture ? light : light * (0.5f * INV_PI), (downs.second - downs.first) * (arounds.second - arounds.first));
    vfloat c, s;
    cos_sin_turn((around < 1.0f) & !t.picture ? around : splat(0.0f), &c, &s);
    const vfloat across = root(t.picture ? splat(0.0f) : down * (splat(2.0f) - down));
    const vec3 on_sphere = vec3_of(across * c, across * s, splat(1.0f) - down);
    *pdf = t.picture ? density * lamp_spread(around, down) : density;
    return frame_to_world(t.frame, choose(t.picture, unit(vec3_of(around, down, splat(1.0f))), on_sphere));
}

// The density with which lamp_table_sample would have chosen it.
static vfloat lamp_table_pdf(const Scene* scene, const LightRow* l, vec3 direction, vmask where) {
    const LampTable t = lamp_table(scene, l, where);
    const vec3 seen = frame_to_local(t.frame, direction);
    const vmask ahead = !t.picture | (seen.z > 0.0f);
    const vfloat inverse = inverse_or_one(ahead ? seen.z : splat(1.0f)), x = seen.x * inverse, y = seen.y * inverse;
    const vfloat down = t.picture ? y : splat(1.0f) - seen.z, around = t.picture ? x : turn_of(seen.x, seen.y);
    const vuint line = search_last(scene->lamp_tables, t.picture ? t.line : t.drop, 1u, down, splat_uint(0u), t.last_line);
    const vuint column = search_last(scene->lamp_tables, t.column, 1u, around, splat_uint(0u), t.last_column);
    const LampPair band = lamp_pair(scene, t.band + line), cell = lamp_pair(scene, t.cell + line * t.columns + column);
    const LampPair downs = lamp_pair(scene, (t.picture ? t.line : t.drop) + line), arounds = lamp_pair(scene, t.column + column);
    const vfloat light = (band.second - band.first) * (cell.second - cell.first);
    const vfloat density = quotient(t.picture ? light : light * (0.5f * INV_PI), (downs.second - downs.first) * (arounds.second - arounds.first));
    const vmask within = ahead & (down >= downs.first) & (down <= downs.second) & (around >= arounds.first) & (around <= arounds.second);
    return within ? (t.picture ? density * lamp_spread(x, y) : density) : splat(0.0f);
}

#ifdef PLUGIN_LIGHTS
// What a plugin is asked for: its number, its parameters, and the frame of its directions, of which x is to the right and y up, as seen
// along z. Beyond its cone it is dark, whatever it says, and so do the tree of lights and its samples take it.
typedef struct {
    Frame frame;
    vuint plugin;                    // 0 of lanes with other lights
    vfloat spread;                   // 1 - cosine of half its cone
    vfloat numbers[PLUGIN_NUMBERS];
} LampGiven;

static void lamp_given(const Scene* scene, const LightRow* l, vmask where, LampGiven* g) {
    const vuint table = where ? vfloat_bits(l->row[LIGHT_ROW_TABLE]) : splat_uint(0u);
    vfloat head[16];
    lane_rows(scene->lamp_tables, table, head);
    lane_rows(scene->lamp_tables, table + 1u, g->numbers);
    g->plugin = where ? vfloat_bits(head[GIVEN_ROW_PLUGIN]) : splat_uint(0u);
    g->spread = where ? head[GIVEN_ROW_SPREAD] : splat(2.0f);
    g->frame.normal = vec3_row(l->row, LIGHT_ROW_AXIS);
    g->frame.tangent = vec3_row(l->row, LIGHT_ROW_ZERO);
    g->frame.bitangent = outer(g->frame.tangent, g->frame.normal);
}

static vmask lamp_given_within(const LampGiven* g, vec3 direction) {
    const vec3 off_axis = sub(direction, g->frame.normal);
    return (inner(off_axis, off_axis) * 0.5f <= g->spread) | (g->spread >= 2.0f);
}

static vec3 lamp_given_share(const Scene* scene, const LightRow* l, vec3 direction, vmask where) {
    LampGiven g;
    lamp_given(scene, l, where, &g);
    const vec3 share = plugin_intensity(g.plugin, g.numbers, frame_to_local(g.frame, direction));
    return color_unbounded(scene, choose(where & lamp_given_within(&g, direction), share, vec3_all(0.0f)));
}

static vec3 lamp_given_sample(const Scene* scene, const LightRow* l, vfloat u, vfloat v, vmask where, vfloat* pdf) {
    LampGiven g;
    lamp_given(scene, l, where, &g);
    const vec3 direction = frame_to_world(g.frame, plugin_emit(g.plugin, g.numbers, g.spread, u, v));
    const vfloat density = plugin_emit_pdf(g.plugin, g.numbers, g.spread, frame_to_local(g.frame, direction));
    *pdf = lamp_given_within(&g, direction) ? density : splat(0.0f);
    return direction;
}

static vfloat lamp_given_pdf(const Scene* scene, const LightRow* l, vec3 direction, vmask where) {
    LampGiven g;
    lamp_given(scene, l, where, &g);
    const vfloat density = plugin_emit_pdf(g.plugin, g.numbers, g.spread, frame_to_local(g.frame, direction));
    return lamp_given_within(&g, direction) ? density : splat(0.0f);
}
#endif

// The density with which a light at a point sends photons into a direction: lamp_sample's, and of others that of all directions.
static vfloat lamp_pdf(const Scene* scene, const LightRow* l, vec3 direction) {
    const vmask spot = l->kind == LIGHT_SPOT, table = lamp_has_table(l);
    vfloat pdf = splat(WARP_SPHERE_PDF);
    if (lane_any(spot)) {
        const vfloat spread = l->row[LIGHT_ROW_SPREAD];
        const vec3 off_axis = sub(direction, vec3_row(l->row, LIGHT_ROW_AXIS));
        const vfloat cone = inner(off_axis, off_axis) * 0.5f <= spread ? warp_cone_pdf(spread > 0.0f ? spread : splat(1.0f)) : splat(0.0f);
        pdf = spot ? cone : pdf;
    }
    if (lane_any(table)) pdf = table ? lamp_table_pdf(scene, l, direction, table) : pdf;
#ifdef PLUGIN_LIGHTS
    const vmask given = lamp_is_given(l);
    if (lane_any(given)) pdf = given ? lamp_given_pdf(scene, l, direction, given) : pdf;
#endif
    return pdf;
}

// What a light at a point sends into a direction, W/sr; of other lights, their radiance.
static vec3 lamp_intensity(const Scene* scene, const LightRow* l, vec3 direction) {
    const vmask spot = l->kind == LIGHT_SPOT, table = lamp_has_table(l);
    vec3 intensity = l->radiance;
    if (lane_any(spot)) intensity = choose(spot, scale(intensity, lamp_spot_share(l, direction)), intensity);
    if (lane_any(table)) intensity = choose(table, mul(intensity, lamp_table_share(scene, l, direction, table)), intensity);
#ifdef PLUGIN_LIGHTS
    const vmask given = lamp_is_given(l);
    if (lane_any(given)) intensity = choose(given, mul(intensity, lamp_given_share(scene, l, direction, given)), intensity);
#endif
    return intensity;
}

// A direction for a photon of a lamp, and its density.
static vec3 lamp_sample(const Scene* scene, const LightRow* l, vfloat u, vfloat v, vfloat* pdf) {
    const vmask table = lamp_has_table(l);
    vec3 direction = lamp_spot_sample(l, u, v, pdf);
    if (lane_any(table)) {
        vfloat table_pdf;
        direction = choose(table, lamp_table_sample(scene, l, u, v, table, &table_pdf), direction);
        *pdf = table ? table_pdf : *pdf;
    }
#ifdef PLUGIN_LIGHTS
    const vmask given = lamp_is_given(l);
    if (lane_any(given)) {
        vfloat given_pdf;
        direction = choose(given, lamp_given_sample(scene, l, u, v, given, &given_pdf), direction);
        *pdf = given ? given_pdf : *pdf;
    }
#endif
    return direction_again(direction);
}

#else

static vmask lamp_at_point(const LightRow* l) { return l->kind == LIGHT_POINT; }
static vec3 lamp_intensity(const Scene* scene, const LightRow* l, vec3 direction) { return l->radiance; }
static vfloat lamp_pdf(const Scene* scene, const LightRow* l, vec3 direction) { return splat(WARP_SPHERE_PDF); }

#endif
#endif
