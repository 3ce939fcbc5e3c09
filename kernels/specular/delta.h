// Vertices of specular chains: deltas whose normal is that of the surface itself, so that it is known how it changes from point to point. Other
// deltas, as those of normal maps, are none, and a path finds light behind them as it always does.
#ifndef SPECULAR_DELTA_H
#define SPECULAR_DELTA_H

#include "geometry/surface.h"
#include "material/bsdf.h"

// What happens on a chain: how many vertices it has, and at which of them light passes; at others it is reflected.
#define SPECULAR_MOST 2u

static vuint chain_kind_of(uint count, uint first_through, uint second_through) { return splat_uint(count | first_through << 2 | second_through << 3); }
static vuint chain_kind_count(vuint kind) { return kind & 3u; }
static vmask chain_kind_through(vuint kind, vuint vertex) { return ((kind >> (vertex + 2u)) & 1u) != 0u; }
static vuint chain_kind_with(vuint kind, vmask through) {
    const vuint bit = through ? splat_uint(4u) : splat_uint(0u);
    return (kind + 1u) | (bit << chain_kind_count(kind));
}

// Whether the vertex can be one of a chain, for a ray that comes along this direction.
static vmask delta_in_chain(const Surface* s, const Bsdf* b, vec3 direction) {
    const vec3 shading = choose(s->front, s->shading, negate(s->shading)), normal = b->frame.normal;
    const vmask own = (shading.x == normal.x) & (shading.y == normal.y) & (shading.z == normal.z);
    vmask fixed = mask_all();
#ifdef TERMINATOR_OFFSET
    fixed = !s->moves;
#endif
#ifdef MATERIALS
    fixed = fixed & !b->mixed;       // which of mixed materials is met changes from point to point
#endif
#ifdef CURVES
    fixed = fixed & !s->curve;       // how their normals change is not known
#endif
    return b->specular & own & fixed & (inner(direction, normal) < -1.0e-6f);
}

// The probability with which a path takes one of the two ways.
static vfloat delta_chosen(const Bsdf* b, vmask through) {
    vfloat reflected = splat(1.0f);
    const vmask glass = b->kind == MATERIAL_DIELECTRIC;
    if (lane_any(glass)) reflected = glass ? bsdf_reflects(b) : reflected;
    const vfloat passing = splat(1.0f) - reflected;
    return through ? (passing > 1.0e-6f ? passing : splat(0.0f)) : reflected;
}

// What the ray does at it: light goes on by reflection, or `through` the surface. weight: f |cosθ|; zero where there is no such way.
static BsdfSample delta_follow(const Bsdf* b, vmask through, vfloat* chosen) {
    BsdfSample s = bsdf_sample(b, through ? splat_uint(NONE) : splat_uint(0u), splat_uint(0u));
    *chosen = delta_chosen(b, through);
    s.weight = scale(s.weight, *chosen);
    return s;
}

// Which way it was that a path goes on in.
static vmask delta_passed(const Bsdf* b, vec3 direction) { return inner(direction, b->frame.normal) < 0.0f; }

// How the direction that delta_follow gives changes, where the incoming direction and the normal (on the side of `wo`) do.
static vec3 delta_change(const Bsdf* b, vmask through, vec3 direction, vec3 d_direction, vec3 d_normal) {
    const vec3 n = b->frame.normal;
    const vfloat cosine = -inner(direction, n), d_cosine = -(inner(d_direction, n) + inner(direction, d_normal));
    const vec3 mirrored = along(along(d_direction, n, d_cosine * 2.0f), d_normal, cosine * 2.0f);
    if (!lane_any(through)) return mirrored;
    const vfloat inverse = quotient(splat(1.0f), b->eta);
    const vfloat beyond2 = fma(fma(cosine, cosine, splat(-1.0f)), inverse * inverse, splat(1.0f));
    const vfloat beyond = root(greater(beyond2, splat(1.0e-12f)));
    const vfloat d_beyond = quotient(cosine * d_cosine * inverse * inverse, beyond);
    const vec3 bent = along(along(scale(d_direction, inverse), n, fma(d_cosine, inverse, -d_beyond)), d_normal, fma(cosine, inverse, -beyond));
#ifdef MATERIALS
    return choose(through, choose(b->thin, d_direction, bent), mirrored);
#else
    return choose(through, bent, mirrored);
#endif
}

#endif
