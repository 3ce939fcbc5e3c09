// Media that absorb and scatter: how far light gets in them (PBR 4ed, 11.2 and 14.1). Those of a grid go their own way (medium/grid.h).
//
// A free path's length is sampled for one of the three channels, each chosen as often as it carries of the throughput, and weighed with the
// density of all three: the balance heuristic, so that no channel weighs more than the inverse of its share. A path that scatters before
// it meets a surface has its next vertex there: its hit says HIT_MEDIUM in the place of a primitive.
//
// Built only where a medium scatters, or there is fog (-D MEDIA).
#ifndef MEDIUM_HOMOGENEOUS_H
#define MEDIUM_HOMOGENEOUS_H

#include "core/roulette.h"
#include "geometry/surface.h"
#include "material/interior.h"
#include "medium/equiangular.h"
#include "medium/grid_colors.h"

#ifdef MEDIA

#define HIT_MEDIUM 0xfffffffeu

static vmask medium_scatters(Hit hit) { return hit.primitive == HIT_MEDIUM; }

// e^(−σ d), by channel.
static vec3 medium_attenuation(vec3 extinction, vfloat distance) {
    return vec3_of(exp_minus(extinction.x * distance), exp_minus(extinction.y * distance), exp_minus(extinction.z * distance));
}

// How far a path gets in the medium that is there before it scatters, if no surface stops it.
typedef struct {
    vfloat length;           // FAR where nothing scatters
    vec3 share;              // how often it was sampled for each channel
#ifdef EQUIANGULAR
    Equiangular lamp;        // and with what share about a lamp instead
#endif
} FreePath;

// Whether the medium of a row is the same everywhere.
static vmask medium_is_even(const vfloat* row) {
#ifdef GRIDS
    return !grid_fills(row);
#else
    return mask_all();
#endif
}

// By what the coefficients of the medium of a row are multiplied at a point in it.
static vfloat medium_density(const Scene* scene, const vfloat* row, vec3 point, vmask where) {
#ifdef GRIDS
    const vmask grid = where & grid_fills(row);
    return lane_any(grid) ? (grid ? grid_density_at(scene, grid_head(row), point, grid) : splat(1.0f)) : splat(1.0f);
#else
    return splat(1.0f);
#endif
}

// How often paths go by the coefficients of each channel: as it carries of the throughput.
static vec3 medium_share(vec3 throughput) { return scale(throughput, inverse_or_one(throughput.x + throughput.y + throughput.z)); }

static FreePath medium_free_path(const Scene* scene, const Interior* in, const Ray* ray, Sampler sampler, vuint depth, vec3 throughput) {
    FreePath free;
    vfloat row[16];
    interior_row(scene, interior_top(in), row);
    const vec3 extinction = vec3_row(row, MEDIUM_ROW_EXTINCTION);
    const vmask may = medium_is_even(row) & interior_collides(row);
    free.length = splat(FAR);
    free.share = vec3_all(0.0f);
#ifdef EQUIANGULAR
    free.lamp = equiangular_none();
#endif
    if (!lane_any(may)) return free;

    // Choose a channel. Each straight crossing since the last vertex has random numbers of its own
    vuint bits_length, bits_channel;
    Sampler own = sampler;
    own.seed ^= in->straight * 0x9e3779b9u;
    sampler_bits(own, sampler_set(depth, SET_MEDIUM), &bits_length, &bits_channel);
    free.share = medium_share(throughput);
    const vfloat u = unit_interval(bits_channel);
    const vfloat chosen = u < free.share.x ? extinction.x : u < free.share.x + free.share.y ? extinction.y : extinction.z;

    // Sample how far it goes
    const vmask goes = may & (chosen > 0.0f);
    free.length = goes ? lesser(quotient(minus_log_of_bits(bits_length), goes ? chosen : splat(1.0f)), splat(FAR)) : splat(FAR);
#ifdef EQUIANGULAR
    const vuint set = sampler_set(depth, SET_MEDIUM);
    free.lamp = equiangular_about_lamp(scene, own, set, depth, ray, inner(free.share, extinction), may & (interior_top(in) == 0u));
    vuint bits_way, unused;
    sampler_hash_bits(own, set, &bits_way, &unused);
    free.length = unit_interval(bits_way) < free.lamp.share ? equiangular_sample(&free.lamp, bits_length) : free.length;
#endif
    return free;
}

// The density with which it ended at this distance, per metre; or the probability that it got further, where it did not scatter.
static vfloat medium_pdf(const FreePath* free, vec3 extinction, vec3 left, vfloat distance, vmask scatters) {
    const vfloat pdf = inner(free->share, choose(scatters, mul(extinction, left), left));
#ifdef EQUIANGULAR
    const vfloat about_lamp = scatters ? equiangular_pdf(&free->lamp, distance) : equiangular_beyond(&free->lamp, distance);
    return free->lamp.share > 0.0f ? fma(free->lamp.share, about_lamp - pdf, pdf) : pdf;
#else
    return pdf;
#endif
}

// Where an extinction is above 0, this per extinction, by channel.
static vec3 medium_per(vec3 some, vec3 extinction) {
    return vec3_of(some.x * inverse_or_one(extinction.x), some.y * inverse_or_one(extinction.y), some.z * inverse_or_one(extinction.z));
}

// Go through that medium, until the hit or, where there is none so near, to where light scatters; the throughput carries what is left. Adds
// the radiance that the medium sends out there to `glow`: what light is absorbed comes from such points, too.
static void medium_travel(
    const Scene* scene, const Interior* in, const Ray* ray, const FreePath* free, vmask alive, vec3* throughput, Hit* hit, vec3* glow
) {
    vfloat row[16];
    interior_row(scene, interior_top(in), row);
    const vec3 extinction = vec3_row(row, MEDIUM_ROW_EXTINCTION), scattering = vec3_row(row, MEDIUM_ROW_SCATTERING);
    const vmask may = alive & interior_collides(row);
    const vec3 arrives = mul(*throughput, interior_absorption(scene, in, ray, *hit, alive & !may));
    if (!lane_any(may)) {
        *throughput = arrives;
        return;
    }
    vmask scatters = may & (hit->primitive == NONE) & (free->length < FAR);
#ifdef HIDDEN_SHAPES
    scatters = scatters & (hit->distance >= free->length);      // not where it ended at what is held out
#endif
    const vmask outside = may & !scatters & (hit->primitive == NONE);
    const vfloat distance = scatters ? free->length : hit->distance;
    const vec3 left = medium_attenuation(extinction, distance);
    const vfloat pdf = medium_pdf(free, extinction, left, distance, scatters);
    const vec3 arrived = lane_any(outside) ? choose(outside, interior_from_outside(scene, interior_top(in)), left) : left;
    const vec3 weight = scale(choose(scatters, mul(scattering, left), arrived), inverse_or_one(pdf));
    vec3 emission = vec3_all(0.0f);
#ifdef GLOWING_MEDIA
    const vmask glows = may & ((vfloat_bits(row[MEDIUM_ROW_FLAGS]) & MEDIUM_FLAG_GLOWS) != 0u);
    emission = choose(glows, vec3_row(row, MEDIUM_ROW_EMISSION), emission);
    *glow = choose(scatters, add(*glow, mul(*throughput, scale(mul(emission, left), inverse_or_one(pdf)))), *glow);
#endif
#ifdef GRIDS
    const vmask grid = may & grid_fills(row);
    if (lane_any(grid)) {
        const GridEvent event =
            grid_travel(scene, grid_head(row), extinction, medium_share(*throughput), ray->origin, ray->direction, hit->distance, grid);
        vec3 albedo = medium_per(scattering, extinction), shines = medium_per(emission, extinction);
        grid_colors(scene, grid_head(row), along(ray->origin, ray->direction, event.distance), event.scatters, &albedo, &shines);
#ifdef GLOWING_MEDIA
        const vec3 sent = mul(mul(*throughput, event.weight), shines);
        *glow = choose(event.scatters, add(*glow, sent), *glow);
#endif
        const vec3 beyond = choose(outside, interior_from_outside(scene, interior_top(in)), vec3_all(1.0f));
        *throughput = choose(grid, mul(mul(*throughput, event.weight), choose(event.scatters, albedo, beyond)), *throughput);
        hit->distance = grid ? event.distance : hit->distance;
        hit->primitive = event.scatters ? splat_uint(HIT_MEDIUM) : hit->primitive;
    }
    const vmask even = may & !grid;
#else
    const vmask even = may;
#endif
    *throughput = choose(even, mul(*throughput, weight), choose(may, *throughput, arrives));
    hit->distance = scatters ? free->length : hit->distance;
    hit->primitive = scatters ? splat_uint(HIT_MEDIUM) : hit->primitive;
}

// A point of the medium as a surface that faces the ray, has no rounding error to leave behind, and scatters by the phase function.
static void medium_surface(const Scene* scene, const Ray* ray, const Interior* in, Hit hit, Surface* s) {
    const vmask here = medium_scatters(hit);
    if (!lane_any(here)) return;
    s->point = choose(here, along(ray->origin, ray->direction, hit.distance), s->point);
    s->error = choose(here, vec3_all(0.0f), s->error);
    s->clearance = here ? splat(0.0f) : s->clearance;
    s->normal = choose(here, negate(ray->direction), s->normal);
    s->shading = choose(here, negate(ray->direction), s->shading);
    s->front = s->front | here;
    s->primitive = here ? splat_uint(HIT_MEDIUM) : s->primitive;
    s->from = here ? splat_uint(NONE) : s->from;
    s->light = here ? splat_uint(NONE) : s->light;
    s->termination = here ? splat(0.0f) : s->termination;
    s->kind = here ? splat_uint(MATERIAL_MEDIUM) : s->kind;
    s->g = here ? lane_gather(scene->media_rows, interior_top(in) * 16u + (uint)MEDIUM_ROW_G) : s->g;
}

// The probability that a path goes on which scatters here, beside what its throughput says: where the medium has no end it may get lost.
static vfloat medium_survival(const Scene* scene, const Interior* in, vmask here, vuint depth) {
    const vmask late = here & (depth >= ROULETTE_LOST_PATH);
    if (!lane_any(late)) return splat(1.0f);
    const vuint flags = vfloat_bits(lane_gather(scene->media_rows, interior_top(in) * 16u + (uint)MEDIUM_ROW_FLAGS));
    return late & ((flags & MEDIUM_FLAG_OPEN) != 0u) ? roulette_lost(depth) : splat(1.0f);
}

// The share of its flux that a path from a light kept which scatters here, for roulette: that of the medium's albedo, about.
static vfloat medium_kept(Hit hit, vec3 sent, vec3 flux) {
    return medium_scatters(hit) ? lesser(largest(flux) * inverse_or_one(largest(sent)), splat(1.0f)) : splat(1.0f);
}

#else

static vmask medium_scatters(Hit hit) { return mask_none(); }
static vfloat medium_kept(Hit hit, vec3 sent, vec3 flux) { return splat(1.0f); }
static vfloat medium_survival(const Scene* scene, const Interior* in, vmask here, vuint depth) { return splat(1.0f); }

typedef struct {
    uint nothing;
} FreePath;

static void medium_travel(
    const Scene* scene, const Interior* in, const Ray* ray, const FreePath* free, vmask alive, vec3* throughput, Hit* hit, vec3* glow
) {
    *throughput = interior_absorb(scene, in, ray, *hit, alive, *throughput);
}
static void medium_surface(const Scene* scene, const Ray* ray, const Interior* in, Hit hit, Surface* s) {}

#endif

#endif
