// Random walks below the surface of skin, wax and marble (Chiang, Kutz and Burley, "Practical and controllable subsurface scattering for
// production path tracing", SIGGRAPH 2016 Talks): the points of a medium that fills a subsurface material.
//
// No light is sampled there, unless something shines inside: no shadow ray passes such a surface. Where the walk meets it from within, light
// is sampled as at any diffuse surface. So a step is one turn of the path's loop, and takes a fraction of the time of others.
//
// Built only where a scene has such a material (-D SUBSURFACE).
#ifndef MEDIUM_WALK_H
#define MEDIUM_WALK_H

#include "integrator/roulette.h"
#include "material/bsdf.h"
#include "medium/homogeneous.h"

#ifdef SUBSURFACE

// From so many scattering events on a walk may end that absorbs nothing. At event n it goes on with the probability 1 − 1/n, so that weights
// grow no faster than n, and hardly ever in a body of less than a hundred mean free paths.
#define WALK_LONG 16384u

static vmask walk_flag(const Scene* scene, vuint medium, uint flag) {
    return (vfloat_bits(lane_gather(scene->media_rows, medium * 16u + (uint)MEDIUM_ROW_FLAGS)) & flag) != 0u;
}

// Where a path scatters in a medium without light, or passes a subsurface material's surface into one.
static vmask walk_in_the_dark(const Scene* scene, const Interior* in, const Crossing* c, const Bsdf* b) {
    const vmask either = b->medium | b->passes;
    if (!lane_any(either)) return either;
    const vuint medium = b->passes ? interior_top(&c->beyond) : interior_top(in);
    return either & walk_flag(scene, either ? medium : splat_uint(0u), MEDIUM_FLAG_DARK);
}

// The probability that a path goes on, at a step of a walk, or where it begins or ends: as its throughput says, without a limit, since what
// absorbs little is no reason to end. Elsewhere `other`. `in`: what it is inside of.
static vfloat walk_survival(const Scene* scene, const Interior* in, const Bsdf* b, uint roulette, vec3 throughput, vuint depth, vfloat other) {
    const vmask walks = b->passes | (b->medium & walk_flag(scene, interior_top(in), MEDIUM_FLAG_SUBSURFACE));
    const vfloat least = roulette == ROULETTE_THROUGHPUT ? lesser(largest(throughput), splat(1.0f)) : splat(1.0f);
    const vfloat early = depth >= 4u ? least : splat(1.0f), late = splat(1.0f) - quotient(splat(1.0f), vfloat_of(vint_from_uint(depth + 1u)));
    return walks ? (depth >= WALK_LONG ? early * late : early) : other;
}

// Where subsurface materials begin, layers show their albedo.
static vmask walk_begins(const Scene* scene, const Surface* s, vmask found, vec3* albedo) {
    const vmask begins = found & s->front & walk_flag(scene, s->medium, MEDIUM_FLAG_SUBSURFACE);
    if (!lane_any(begins)) return begins;
    vfloat row[16];
    lane_rows(scene->media_rows, begins ? s->medium : splat_uint(0u), row);
    *albedo = choose(begins, vec3_row(row, MEDIUM_ROW_ALBEDO), *albedo);
    return begins;
}

#else

static vmask walk_in_the_dark(const Scene* scene, const Interior* in, const Crossing* c, const Bsdf* b) { return mask_none(); }
static vfloat walk_survival(const Scene* scene, const Interior* in, const Bsdf* b, uint roulette, vec3 throughput, vuint depth, vfloat other) { return other; }
static vmask walk_begins(const Scene* scene, const Surface* s, vmask found, vec3* albedo) { return mask_none(); }

#endif

#endif
