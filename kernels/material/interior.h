// Which dielectrics a path is inside of, and what that makes of a surface that it meets (Schmidt and Budge, "Simple nested dielectrics
// in ray traced images", Journal of Graphics Tools 7(2), 2002).
//
// Every dielectric is a medium with a number, and fills the inside of closed shapes. Where several overlap, the one of the highest number
// is there: the host numbers them by their priorities. A path carries the list of the media around it, highest first. A surface
// is a boundary only where the first of the list is another one beyond it; elsewhere the path goes straight on, and no scattering
// event is counted. Media without a priority have the lowest numbers. Their surfaces always are boundaries, between the indices that
// their material names; in the list they stand behind all others, the one entered last first.
//
// Volumes are closed. So a ray that leaves the scene is outside of all of them, whatever the list says: where a mesh has a hole, or faces of
// two volumes coincide and only one of them is found, a white environment stays white.
//
// Built only where a scene has priorities or absorbing dielectrics (-D INTERIORS): elsewhere all of this is nothing.
#ifndef MATERIAL_INTERIOR_H
#define MATERIAL_INTERIOR_H

#include "core/roulette.h"
#include "core/sampler.h"
#include "geometry/surface.h"
#include "medium/grid.h"
#include "scene.h"
#include "spectral/color.h"

#ifdef INTERIORS

// So many media are known at a point; of more, the lowest are forgotten.
#define INTERIOR_ENTRIES 8

typedef struct {
    vuint first, last;       // the list, a byte each, from the highest byte of `first` on; 0: no medium
    vuint straight;          // surfaces so far that were no boundaries
} Interior;

// What a path finds where it meets a surface.
typedef struct {
    vmask straight;          // the surface is no boundary
    Interior beyond;         // the list on its other side
} Crossing;

static Interior interior_none(void) {
    Interior in;
    in.first = in.last = in.straight = splat_uint(0u);
    return in;
}

// Take the other list where the statement holds.
static void interior_replace(Interior* in, Interior other, vmask m) {
    in->first = m ? other.first : in->first;
    in->last = m ? other.last : in->last;
    in->straight = m ? other.straight : in->straight;
}

// A ray of the camera begins.
static void interior_start(const Scene* scene, Interior* in, vmask lane) {
    Interior camera;
    camera.first = splat_uint(scene->camera->interior_first);
    camera.last = splat_uint(scene->camera->interior_last);
    camera.straight = splat_uint(0u);
    interior_replace(in, camera, lane);
}

// The medium that is there; 0: none.
static vuint interior_top(const Interior* in) { return in->first >> 24; }

static vuint interior_entry(const Interior* in, int i) { return ((i < 4 ? in->first : in->last) >> (24 - 8 * (i & 3))) & 255u; }
static void interior_append(Interior* in, vuint medium) {
    in->first = (in->first << 8) | (in->last >> 24);
    in->last = (in->last << 8) | medium;
}

// So many media have no priority: they have the lowest numbers.
static uint interior_unranked(const Scene* scene) { return as_uint(scene->media_rows[MEDIUM_ROW_UNRANKED]); }

// Index of refraction; of no medium 1. And whether that depends on the wavelength.
static vfloat interior_dispersive_ior(const Scene* scene, vuint medium, vmask* disperses) {
    return color_index(scene, lane_gather(scene->media_rows, medium * 16u + (uint)MEDIUM_ROW_IOR), disperses);
}
static vfloat interior_ior(const Scene* scene, vuint medium) {
    vmask unused = mask_none();
    return interior_dispersive_ior(scene, medium, &unused);
}

// The row of a medium, with its coefficients at the lanes' wavelengths.
static void interior_row(const Scene* scene, vuint medium, vfloat row[16]) {
    lane_rows(scene->media_rows, medium, row);
#ifdef SPECTRAL
    vec3_row_put(row, MEDIUM_ROW_SIGMA, color_unbounded(scene, vec3_row(row, MEDIUM_ROW_SIGMA)));
#ifdef MEDIA
    vec3_row_put(row, MEDIUM_ROW_EXTINCTION, color_unbounded(scene, vec3_row(row, MEDIUM_ROW_EXTINCTION)));
    vec3_row_put(row, MEDIUM_ROW_SCATTERING, color_unbounded(scene, vec3_row(row, MEDIUM_ROW_SCATTERING)));
#endif
#ifdef GLOWING_MEDIA
    const vmask glows = (vfloat_bits(row[MEDIUM_ROW_FLAGS]) & MEDIUM_FLAG_GLOWS) != 0u;
    vec3_row_put(row, MEDIUM_ROW_EMISSION, color_light(scene, choose(glows, vec3_row(row, MEDIUM_ROW_EMISSION), vec3_all(0.0f))));
#endif
#endif
}

// The list with one more medium: before those that it wins over, and before its equals.
static Interior interior_with(const Interior* in, vuint medium, uint unranked) {
    const vuint wins = medium > unranked ? medium : splat_uint(unranked);
    vmask placed = mask_none();
    vuint carried = medium;
    Interior out = interior_none();
    for (int i = 0; i < INTERIOR_ENTRIES; ++i) {
        const vuint entry = interior_entry(in, i);
        placed = placed | (entry <= wins);
        interior_append(&out, placed ? carried : entry);
        carried = placed ? entry : carried;
    }
    return out;
}

// The list without it, once; a medium that is not there takes nothing away.
static Interior interior_without(const Interior* in, vuint medium) {
    vmask gone = mask_none();
    Interior out = interior_none();
    for (int i = 0; i < INTERIOR_ENTRIES; ++i) {
        const vuint entry = interior_entry(in, i);
        const vuint next = i + 1 < INTERIOR_ENTRIES ? interior_entry(in, i + 1) : splat_uint(0u);
        gone = gone | (entry == medium);
        interior_append(&out, gone ? next : entry);
    }
    return out;
}

// What the surface is to a path with this list; of a boundary, the surface's index becomes that of what is behind its front over that
// of what is before it.
static Crossing interior_meet(const Scene* scene, const Interior* in, Surface* s, vmask found) {
    Crossing c;
    c.straight = mask_none();
    c.beyond = *in;
    const vmask meets = found & (s->medium != 0u);
    if (!lane_any(meets)) return c;
    const uint unranked = interior_unranked(scene);
    const Interior with = interior_with(in, s->medium, unranked), without = interior_without(in, s->medium);
    c.beyond.first = meets ? (s->front ? with.first : without.first) : in->first;
    c.beyond.last = meets ? (s->front ? with.last : without.last) : in->last;
    vmask disperses = mask_none();
    const vfloat here = interior_dispersive_ior(scene, interior_top(in), &disperses);
    const vfloat there = interior_dispersive_ior(scene, interior_top(&c.beyond), &disperses);
    const vmask ranked = meets & (s->medium > unranked);
    s->ior = ranked ? (s->front ? quotient(there, here) : quotient(here, there)) : s->ior;
#ifdef DISPERSION
    s->disperses = s->disperses | (ranked & disperses);
#endif
    c.straight = ranked ? here == there : meets & (s->ior == 1.0f);
    return c;
}

static vmask interior_straight(const Crossing* c) { return c->straight; }

// The list with which a ray leaves the surface in this direction; `side` is the normal on the side that the path came from.
static Interior interior_towards(const Interior* in, const Crossing* c, vec3 direction, vec3 side) {
    Interior out = *in;
    interior_replace(&out, c->beyond, c->straight | (inner(direction, side) < 0.0f));
    return out;
}

// The path goes on in this direction.
static void interior_cross(Interior* in, const Crossing* c, vec3 direction, vec3 side) {
    *in = interior_towards(in, c, direction, side);
    in->straight = c->straight ? in->straight + 1u : in->straight;
}

// Whether paths go on that went straight, and by how much they then count for more: only after very many such surfaces they may end.
static vmask interior_goes_on(const Interior* in, const Crossing* c, Sampler sampler, vec3* throughput) {
    const vmask played = c->straight & (in->straight >= ROULETTE_LONG_PATH);
    if (!lane_any(played)) return mask_all();
    const vfloat survival = roulette_late(in->straight);
    vuint bits, unused;
    sampler_hash_bits(sampler, sampler_set(in->straight, SET_SPARE), &bits, &unused);
    *throughput = choose(played, scale(*throughput, inverse_or_one(survival)), *throughput);
    return !played | (unit_interval(bits) < survival);
}

// Whether light gets endlessly far, by channel: 1 where none of these coefficients stops it, else 0.
static vec3 interior_endless(vec3 coefficients) {
    const vfloat none = splat(0.0f), one = splat(1.0f);
    return vec3_of(coefficients.x > 0.0f ? none : one, coefficients.y > 0.0f ? none : one, coefficients.z > 0.0f ? none : one);
}

// What the fog leaves of light from outside the scene.
static vec3 interior_through_fog(const Scene* scene) {
#ifdef MEDIA
    __global const float* fog = scene->media_rows + MEDIUM_ROW_EXTINCTION;
    return interior_endless(color_unbounded(scene, vec3_of(splat(fog[0]), splat(fog[1]), splat(fog[2]))));
#else
    return vec3_all(1.0f);
#endif
}

// Where paths come to a halt in a medium, which they do where it scatters or shines.
static vmask interior_collides(const vfloat* row) {
    const vmask scatters = largest(vec3_row(row, MEDIUM_ROW_SCATTERING)) > 0.0f;
#ifdef GLOWING_MEDIA
    return scatters | ((vfloat_bits(row[MEDIUM_ROW_FLAGS]) & MEDIUM_FLAG_GLOWS) != 0u);
#else
    return scatters;
#endif
}

// What is left of radiance from outside the scene. It becomes n² times as much in a medium of index n, for the list has to be empty out
// there (PBR 4ed, 9.5.2). In a medium that scatters, paths do so before they get that far.
static vec3 interior_from_outside(const Scene* scene, vuint medium) {
    const vfloat n = medium > interior_unranked(scene) ? interior_ior(scene, medium) : splat(1.0f);
    vec3 share = vec3_of(n * n, n * n, n * n);
#ifdef MEDIA
    vfloat row[16];
    interior_row(scene, medium, row);
    vmask ends = !interior_collides(row);
#ifdef GRIDS
    ends = ends | grid_fills(row);
#endif
    const vec3 here = choose(ends, vec3_all(1.0f), interior_endless(vec3_row(row, MEDIUM_ROW_EXTINCTION)));
    share = mul(mul(share, here), interior_through_fog(scene));
#endif
    return share;
}

// What is left of radiance after a way through the medium that is there: e^(−σ d), Beer's law, with the coefficients from this column of
// its row on; of a grid, an estimate where it is `asked`. The way begins at `origin`, in a unit direction.
static vec3 interior_attenuation(
    const Scene* scene, const Interior* in, uint column, vec3 origin, vec3 direction, vfloat distance, vmask from_outside, vmask asked
) {
    const vuint medium = interior_top(in);
#ifndef MEDIA
    if (!lane_any(medium != 0u)) return vec3_all(1.0f);      // with media there may be fog
#endif
    const vuint row = medium * 16u + column;
    const vec3 words = vec3_of(lane_gather(scene->media_rows, row), lane_gather(scene->media_rows, row + 1u), lane_gather(scene->media_rows, row + 2u));
    const vec3 sigma = color_unbounded(scene, words);
    vec3 share = vec3_of(exp_minus(sigma.x * distance), exp_minus(sigma.y * distance), exp_minus(sigma.z * distance));
#ifdef GRIDS
    vfloat numbers[16];
    interior_row(scene, medium, numbers);
    const vmask grid = asked & grid_fills(numbers);
    if (lane_any(grid)) {
        const vec3 coefficients = vec3_row(numbers, (int)column);
        const vec3 passes = grid_transmittance(scene, grid_head(numbers), coefficients, origin, direction, from_outside ? splat(FAR) : distance, grid);
        share = choose(grid, choose(from_outside, mul(passes, interior_from_outside(scene, medium)), passes), share);
        from_outside = from_outside & !grid;
    }
#endif
    if (lane_any(from_outside)) share = choose(from_outside, interior_from_outside(scene, medium), share);
    return share;
}

// Of light on its way to where it is asked for: what is scattered away does not arrive, either.
static vec3 interior_transmittance(
    const Scene* scene, const Interior* in, vec3 origin, vec3 direction, vfloat distance, vmask from_outside, vmask asked
) {
    return interior_attenuation(scene, in, MEDIUM_ROW_EXTINCTION, origin, direction, distance, from_outside, asked);
}

// What absorption leaves at the end of a ray that has come this far; and of radiance, or flux.
static vec3 interior_absorption(const Scene* scene, const Interior* in, const Ray* ray, Hit hit, vmask asked) {
    return interior_attenuation(scene, in, MEDIUM_ROW_SIGMA, ray->origin, ray->direction, hit.distance, hit.primitive == NONE, asked);
}
static vec3 interior_absorb(const Scene* scene, const Interior* in, const Ray* ray, Hit hit, vmask asked, vec3 radiance) {
    return mul(radiance, interior_absorption(scene, in, ray, hit, asked));
}

#else

typedef struct {
    uint nothing;
} Interior;

typedef struct {
    uint nothing;
} Crossing;

static Interior interior_none(void) {
    Interior in;
    in.nothing = 0u;
    return in;
}
static void interior_replace(Interior* in, Interior other, vmask m) {}
static void interior_start(const Scene* scene, Interior* in, vmask lane) {}
static Crossing interior_meet(const Scene* scene, const Interior* in, Surface* s, vmask found) {
    Crossing c;
    c.nothing = 0u;
    return c;
}
static vmask interior_straight(const Crossing* c) { return mask_none(); }
static Interior interior_towards(const Interior* in, const Crossing* c, vec3 direction, vec3 side) { return *in; }
static void interior_cross(Interior* in, const Crossing* c, vec3 direction, vec3 side) {}
static vmask interior_goes_on(const Interior* in, const Crossing* c, Sampler sampler, vec3* throughput) { return mask_all(); }
static vec3 interior_through_fog(const Scene* scene) { return vec3_all(1.0f); }
static vec3 interior_transmittance(
    const Scene* scene, const Interior* in, vec3 origin, vec3 direction, vfloat distance, vmask from_outside, vmask asked
) {
    return vec3_all(1.0f);
}
static vec3 interior_absorb(const Scene* scene, const Interior* in, const Ray* ray, Hit hit, vmask asked, vec3 radiance) { return radiance; }

#endif

// A surface that is no boundary changes neither the direction nor the light.
static void interior_straighten(const Crossing* c, vec3 direction, vec3* next, vec3* weight) {
    *next = choose(interior_straight(c), direction, *next);
    *weight = choose(interior_straight(c), vec3_all(1.0f), *weight);
}

#endif
