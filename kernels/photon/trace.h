// Photons on their way from the lights: at every surface of the material `lambert` that is not black and that they reach after at least one
// scattering event they leave a deposit, and so they do where they scatter in a medium. Light that comes straight from the lights is found by shadow rays, with less noise.
#ifndef PHOTON_TRACE_H
#define PHOTON_TRACE_H

#include "camera/shutter.h"
#include "camera/surroundings.h"
#include "core/roulette.h"
#include "geometry/find.h"
#include "geometry/surface.h"
#include "material/bsdf.h"
#include "material/interior.h"
#include "material/reversed.h"
#include "material/turning.h"
#include "medium/flux.h"
#include "medium/walk.h"
#include "photon/ball.h"
#include "photon/deposit.h"
#include "photon/disk.h"
#include "photon/emit.h"
#include "types.h"

typedef struct {
    vmask alive;
    vuint number;        // of the photon
    Sampler sampler;
    Ray ray;
    vec3 flux;
    vuint depth;         // scattering events so far
    vuint deposits;
    vmask specular;      // all scattering events so far were at mirrors and glass
    Interior interior;   // the dielectrics that the ray begins in
} Photon;

static Photon photon_none(void) {
    Photon p;
    p.alive = p.specular = mask_none();
    p.interior = interior_none();
    p.number = p.depth = p.deposits = p.sampler.seed = p.sampler.index = splat_uint(0u);
    p.ray = ray_make(vec3_all(0.0f), vec3_all(1.0f));
    p.flux = vec3_all(0.0f);
    return p;
}

// Photons of one pass are one sequence of numbers, so that they spread evenly over the lights.
static void photon_start(const Scene* scene, float4 bounds, uint pass, vuint number, vmask start, Photon* p) {
    p->number = start ? number : p->number;
    p->sampler.seed = start ? hash_pair(hash_pair(splat_uint(pass), splat_uint(scene->settings->seed)), splat_uint(0x9b05688cu)) : p->sampler.seed;
    p->sampler.index = p->number;
    const Emission e = emission_sample(scene, p->sampler, bounds, shutter_time_of_pass(scene, pass));
    ray_replace(&p->ray, e.ray, start);
    p->flux = choose(start, choose(e.far, mul(e.flux, interior_through_fog(scene)), e.flux), p->flux);
    p->depth = start ? splat_uint(0u) : p->depth;
    p->deposits = start ? splat_uint(0u) : p->deposits;
    p->specular = p->specular | start;
    interior_replace(&p->interior, interior_none(), start);
#ifdef LIGHTS_IN_MEDIA
    const vmask near = start & !e.far;
    if (lane_any(near)) interior_replace(&p->interior, surroundings_at(scene, e.ray.origin, near, ray_time(&e.ray)), near);
#endif
    p->alive = p->alive | start;
}

// Keep the deposit in the next free place of its photon; when all are taken, in a random one or nowhere, so that at any time each
// deposit so far is as likely to be there (Vitter 1985). `kind`: DEPOSIT_ROW_KIND.
static void photon_deposit(const Photon* p, const Surface* s, vec3 flux, vuint kind, vmask where, __global float* deposits) {
    vuint random, unused;
    sampler_hash_bits(p->sampler, sampler_set(p->depth, SET_LIGHT), &random, &unused);
    const vuint drawn = mul_hi(random, p->deposits + 1u), place = p->deposits < PHOTON_DEPOSITS ? p->deposits : drawn;
    const vmask kept = where & (place < PHOTON_DEPOSITS);
    const vfloat events = vfloat_of(vint_from_uint(p->depth));
    const vec3 side = choose(s->front, s->normal, negate(s->normal));
    vfloat words[11];
    vec3_row_put(words, DEPOSIT_ROW_POINT, s->point);
    vec3_row_put(words, DEPOSIT_ROW_NORMAL, choose(deposit_is_in_medium(kind), p->ray.direction, side));
    vec3_row_put(words, DEPOSIT_ROW_FLUX, flux);
    words[DEPOSIT_ROW_EVENTS] = p->specular ? -events : events;
    words[DEPOSIT_ROW_KIND] = vfloat_from_bits(kind);
    int is_kept[LANES];
    uint at[LANES];
    float word[LANES];
    lane_store(kept, is_kept);
    lane_store(p->number * PHOTON_DEPOSITS + place, at);
    for (uint k = 0; k < 11u; ++k) {
        lane_store(words[k], word);
        for (int lane = 0; lane < LANES; ++lane)
            if (is_kept[lane]) deposits[(size_t)at[lane] * DEPOSIT_WORDS + k] = word[lane];
    }
}

// Where the flux counts for who gathers it by the normal that is seen there, which a map bends towards who looks.
static vmask photon_is_bent(const Surface* surface, const Bsdf* bsdf) {
#ifdef TEXTURES
    return bsdf_is_bent(surface, bsdf);
#else
    return mask_none();
#endif
}

#if defined(HAIR) && defined(CURVES)
// The place of a fibre that a ray along -`w` meets which passes its axis on one side or the other, by so much of the radius. Its point stays that of the
// hit, which chooses among mixed materials.
static Surface photon_fibre(const Surface* surface, vec3 w, vfloat across) {
    Surface s = *surface;
    const vec3 flat = along(w, s.tangent, -inner(w, s.tangent));
    const vec3 towards = unit(choose(inner(flat, flat) > 1.0e-12f, flat, s.normal));
    s.normal = s.shading = unit(along(scale(towards, root(fma(-across, across, splat(1.0f)))), outer(s.tangent, towards), across));
    s.clearance = ray_clearance(s.normal, s.error);
    s.front = mask_all();
    return s;
}

// Paths from the camera know how far from a fibre's axis light leaves it, not where it has arrived (DECISIONS.md 110). Photons arrive everywhere across
// it: so each may be taken for one that has come at any distance from the axis, and that by the same way through the fibre leaves as far from the axis,
// on the other side. `surface` becomes the place where it does. Returns the weight of the direction, which is sampled here.
static vec3 photon_from_fibre(const Scene* scene, const Photon* p, vuint bits_u, vuint bits_v, vmask where, Surface* surface, vec3* direction) {
    vuint random, unused;
    sampler_hash_bits(p->sampler, sampler_set(p->depth, SET_LOBE), &random, &unused);
    const vfloat across = fma(unit_interval(random), splat(2.0f), splat(-1.0f)), one = splat(1.0f);
    const vec3 from = negate(p->ray.direction);
    const Surface met = photon_fibre(surface, from, across);
    Bsdf bsdf;
    bsdf_at(scene, &met, p->ray.direction, &bsdf);
    const BsdfSample next = bsdf_sample(&bsdf, bits_u, bits_v);
    const Surface left = photon_fibre(surface, next.direction, -across);
    vfloat pdf;
    const vec3 f = bsdf_made_again(scene, &left, from, next.direction, &pdf);
    const vfloat sine_i = inner(from, surface->tangent), sine_o = inner(next.direction, surface->tangent);
    const vfloat in = root(fma(-sine_i, sine_i, one)), out = root(fma(-sine_o, sine_o, one));
    surface->point = choose(where, along(surface->point, sub(left.normal, surface->normal), surface->radius), surface->point);
    surface->normal = choose(where, left.normal, surface->normal);
    surface->clearance = where ? left.clearance : surface->clearance;
    *direction = choose(where, next.direction, *direction);
    const vmask sent = (largest(next.weight) > 0.0f) & (next.pdf > 0.0f);
    return choose(sent, scale(f, out * inverse_or_one(in * next.pdf)), vec3_all(0.0f));
}
#endif

// Choose where the photon goes on; it does with the probability of its largest weight, and its flux keeps its size. `sent`: its flux before it came
// here, of which a medium may have absorbed a part.
static vmask photon_scatter(const Scene* scene, Photon* p, Surface* surface, const Bsdf* bsdf, const Crossing* crossing, vec3 sent, Hit hit,
                            vmask found) {
    const vmask straight = interior_straight(crossing);
    vuint bits_u, bits_v;
    sampler_bits(p->sampler, sampler_set(p->depth, SET_BSDF), &bits_u, &bits_v);
    BsdfSample next = bsdf_sample(bsdf, bits_u, bits_v);
    // bsdf_sample weighs radiance, and this is flux
    const vfloat turned = bsdf_turned(bsdf, p->ray.direction, next.direction) * bsdf_index_squared(bsdf, next.direction);
    vec3 weight = scale(next.weight, bsdf_in_medium(bsdf) ? splat(1.0f) : turned);
#ifdef BSDF_MADE_AGAIN
    // What is not reciprocal is as it is seen from where the photon goes, and so are normals that are bent towards who looks
    vmask one_way = bsdf_is_bent(surface, bsdf) & !bsdf_is_clear(bsdf) & !bsdf_passes(bsdf);
#if defined(MEASURED) || defined(HAIR)
    one_way = one_way | (bsdf->closure.present & closure_is_one_way(&bsdf->closure));
#endif
    one_way = found & one_way & (next.pdf > 0.0f);
    if (lane_any(one_way)) {
        vfloat back;
        const vec3 f = bsdf_reversed(scene, surface, bsdf, negate(p->ray.direction), next.direction, one_way, &back);
        const vfloat in = absolute(inner(surface->normal, p->ray.direction)), out = absolute(inner(surface->normal, next.direction));
        weight = choose(one_way, choose(largest(next.weight) > 0.0f, scale(f, out * inverse_or_one(in * next.pdf)), vec3_all(0.0f)), weight);
    }
#endif
#if defined(HAIR) && defined(CURVES)
    const vmask fibre = found & surface->curve & bsdf->closure.present & bsdf->closure.hair.present;
    if (lane_any(fibre)) weight = choose(fibre, photon_from_fibre(scene, p, bits_u, bits_v, fibre, surface, &next.direction), weight);
#endif
    interior_straighten(crossing, p->ray.direction, &next.direction, &weight);
    const vfloat late = straight ? splat(1.0f) : roulette_late(p->depth + 1u);
    const vfloat open = medium_survival(scene, &p->interior, medium_scatters(hit), p->depth + 1u);
    const vfloat survival = roulette_by_flux(weight) * medium_kept(hit, sent, p->flux) * late * open;
    p->flux = mul(p->flux, scale(weight, inverse_or_one(survival)));
    p->ray = surface_leave(surface, next.direction);
    interior_cross(&p->interior, crossing, next.direction, bsdf->side);
    const vmask goes_on = interior_goes_on(&p->interior, crossing, p->sampler, &p->flux);
    sampler_hash_bits(p->sampler, sampler_set(p->depth, SET_ROULETTE), &bits_u, &bits_v);
    p->depth = straight ? p->depth : p->depth + 1u;
    return found & goes_on & ((p->depth < scene->settings->max_depth) | straight) & (unit_interval(bits_u) < survival);
}

// The photons [first, last) of a pass. Returns the rays.
static uint photon_trace(const Scene* scene, float4 bounds, uint pass, uint first, uint last, __global float* deposits,
                         __global uint* deposit_counts) {
    Photon photon = photon_none();
    uint next = first, rays = 0;

    for (;;) {
        // Lanes without a photon start the next
        if (lane_any(!photon.alive)) {
            const vuint number = next + lane_rank(!photon.alive);
            const vmask start = !photon.alive & (number < last);
            next += (uint)lane_count(!photon.alive);
            if (lane_any(start)) photon_start(scene, bounds, pass, number, start, &photon);
            if (!lane_any(photon.alive)) return rays;
        }

        // Find where the photon arrives, and leave a deposit if that is diffuse and not the first place
        const vec3 sent = photon.flux;
        const Hit hit = flux_travel(scene, &photon.interior, &photon.ray, photon.sampler, photon.depth, photon.alive, &photon.flux);
        const vmask found = photon.alive & (hit.primitive != NONE), on_surface = found & !medium_scatters(hit);
        Surface surface = surface_at(scene, &photon.ray, hit, on_surface);
        medium_surface(scene, &photon.ray, &photon.interior, hit, &surface);
        const Crossing crossing = interior_meet(scene, &photon.interior, &surface, on_surface);
        Bsdf bsdf;
        bsdf_at(scene, &surface, photon.ray.direction, &bsdf);
        const vmask dark = walk_in_the_dark(scene, &photon.interior, &crossing, &bsdf);
        const vmask in_medium = found & ball_receives(scene, &photon.interior, &bsdf, dark);
        const vmask arrives = ((on_surface & disk_receives(&surface)) | in_medium) & (photon.depth > 0u);
        rays += lane_count(photon.alive);
        if (lane_any(arrives)) {
            const vec3 scattered = ball_flux(scene, &photon.interior, surface.point, photon.flux, in_medium);
            const vmask bent = photon_is_bent(&surface, &bsdf);
            const vfloat shaded = bent ? splat(1.0f) : bsdf_shaded(&bsdf, photon.ray.direction);
            const vec3 flux = choose(in_medium, scattered, scale(photon.flux, shaded));
            const vuint kind = bent ? deposit_from(photon.ray.direction) : splat_uint(0u);
            photon_deposit(&photon, &surface, flux, in_medium ? ball_medium(&photon.interior) : kind, arrives, deposits);
            photon.deposits = arrives ? photon.deposits + 1u : photon.deposits;
        }

        // Go on, or end and say how many deposits there were
        photon.specular = photon.specular & bsdf.specular;
        const vmask goes_on = photon_scatter(scene, &photon, &surface, &bsdf, &crossing, sent, hit, found);
        const vmask ended = photon.alive & !goes_on;
        if (lane_any(ended)) {
            int has_ended[LANES];
            uint number[LANES], count[LANES];
            lane_store(ended, has_ended);
            lane_store(photon.number, number);
            lane_store(photon.deposits, count);
            for (int lane = 0; lane < LANES; ++lane)
                if (has_ended[lane]) deposit_counts[number[lane]] = count[lane];
        }
        photon.alive = photon.alive & !ended;
    }
}

#endif
