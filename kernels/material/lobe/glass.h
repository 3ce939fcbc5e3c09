// Rough glass: microfacets that reflect and refract (Walter et al., EGSR 2007), sampled by visible normals, with Fresnel's equations at
// each facet. What meets more than one facet is added by diffuse lobes on both sides, in the manner of Kulla & Conti (SIGGRAPH course
// 2017): with E(μ) what both lobes return at first, and ' for the other side,
//     reflected:    r (1 − E(μo)) (1 − E(μi)) / (π (1 − E_avg)),    transmitted:    s (1 − E(μo)) (1 − E'(μi)) / π,
// where s is the same from both sides but for the squared index, so that light paths can be reversed, and r is what is left. A thin wall
// is two such boundaries at once (PBR 4ed, 9.5.3, "thin dielectric"): it does not bend light, and what passes spreads as what is reflected.
// Frame: local, z = shading normal on the side of `wo`. eval: f in 1/sr of radiance, which is scaled by 1/eta² where it crosses.
#ifndef MATERIAL_LOBE_GLASS_H
#define MATERIAL_LOBE_GLASS_H

#include "material/albedo.h"
#include "material/beckmann.h"
#include "material/dielectric.h"
#include "material/fresnel.h"
#include "material/thin_film.h"
#ifdef TURNED_GLASS
#include "material/turned_glass.h"
#endif

typedef struct {
    vmask present, thin;
    vmask beckmann;          // the facets' distribution; else GGX
    vuint base;              // of the tables: albedo_base
    vec3 color;              // of what passes
    vfloat share;            // of the surface
    vfloat alpha, eta;       // index beyond over index on this side; thin: of the wall over the outside
    vfloat missing;          // 1 − E(μo); 0 where light meets one facet only
    vfloat passes;           // of what both lobes leave over, the share that is transmitted
    vfloat back, through;    // scales of the diffuse lobes: r / (π (1 − E_avg)), s / π
    vfloat squeezed;         // 1/eta², thin: 1
    vfloat layer;            // of the tables
    vfloat critical;         // cosine of the critical angle
    vfloat bend;             // columns from one end of its bend to the other
    vfloat level;            // of them, how far the horizon is from the middle
#ifdef IRIDESCENCE
    ThinFilm film;           // on its outside
#endif
#ifdef TURNED_GLASS
    TurnedGlass turned;      // where facets are rougher along x
#endif
} Glass;

// How far a cosine is from the critical one: from −1 to 1, and most of that within a few alphas (scripts/albedo_tables.py, glass_column).
static vfloat glass_bend(const Glass* g, vfloat cosine) {
    const vfloat apart = cosine - g->critical;
    return quotient(apart, fma(g->alpha, splat(3.0f), absolute(apart)));
}

// Where the tables have an index, and the bend.
static void glass_place(Glass* g, const Facets* f, vfloat index) {
    const vfloat t = root(quotient(index - 1.0f, index + 1.0f));
    g->layer = quotient(t * (1.3f * (float)(GLASS_LAYERS - 1u)), t + 0.3f);
    g->critical = quotient(root((index - 1.0f) * (index + 1.0f)), index);
    const vfloat lowest = glass_bend(g, splat(0.0f));
    g->bend = quotient(splat(0.23f), glass_bend(g, splat(1.0f)) - lowest);
    g->level = -lowest * g->bend;
#ifdef TURNED_GLASS
    g->turned.layer = quotient(t * 1.3f, t + 0.3f);
    g->turned.critical = g->critical;
    g->turned.row = root(f->alpha.x);
    g->turned.apart = quotient(f->apart, splat((float)(TURNED_APART - 1u)));
#endif
}

// The layer before it, of the denser medium's or the thinner one's, and how far the next is.
static vuint glass_layer(const Glass* g, vmask denser, vfloat* further) {
    const vint layer = vint_of(lesser(g->layer, splat((float)(GLASS_LAYERS - 2u))));
    *further = g->layer - vfloat_of(layer);
    return vuint_from_int(layer) + (denser ? splat_uint(GLASS_LAYERS) : splat_uint(0u));
}

// 1 − E(μ) of light within the denser medium, or the thinner one.
static vfloat glass_missing(const Glass* g, const Facets* f, __global const float* tables, vmask denser, vec3 w) {
    const vfloat cosine = w.z;
    vfloat further;
    const uint words = GLASS_COLUMNS - 1u, next = GLASS_ROWS * words;
    const vuint first = glass_layer(g, denser, &further) * next + g->base + ALBEDO_GLASS;
    // One division for albedo_column and glass_bend
    const vfloat apart = cosine - g->critical, sum = cosine + g->alpha, reach = fma(g->alpha, splat(3.0f), absolute(apart));
    const vfloat inverse = quotient(splat(1.0f), sum * reach), square = cosine * cosine;
    const vfloat by_slope = root(cosine * fma(g->alpha, reach, reach) * inverse);
    const vfloat bend = denser ? fma(apart * sum * inverse, g->bend, g->level) : splat(0.0f);
    const vfloat column = fma(by_slope, denser ? splat(0.7f) : splat(0.93f), fma(square * square, splat(0.07f), bend));
    const vfloat y = root(g->alpha) * (float)(GLASS_ROWS - 1u), x = column * (float)words, low = albedo_at(tables, first, GLASS_ROWS, words, words, y, x);
    const vfloat high = albedo_at(tables, first + next, GLASS_ROWS, words, words, y, x);
    vfloat e = fma(further, high - low, low);
    if (lane_any(g->present & g->thin)) e = g->thin ? albedo_facets(tables, f, w) : e;
#ifdef TURNED_GLASS
    const vmask turned = g->present & !g->thin & f->turned;
    if (lane_any(turned)) e = turned ? turned_glass_albedo(tables, f, &g->turned, denser, w) : e;
#endif
    return splat(1.0f) - e;
}
// 1 − E_avg.
static vfloat glass_lost(const Glass* g, const Facets* f, __global const float* tables, vmask denser) {
    vfloat further;
    const vuint first = glass_layer(g, denser, &further) * GLASS_LOST_ROWS + g->base + ALBEDO_GLASS_LOST;
    const vfloat low = albedo_line(tables, first, GLASS_LOST_ROWS, g->alpha);
    const vfloat high = albedo_line(tables, first + GLASS_LOST_ROWS, GLASS_LOST_ROWS, g->alpha);
    vfloat lost = g->thin ? albedo_facets_lost(tables, f) : fma(further, high - low, low) * g->alpha;
#ifdef TURNED_GLASS
    const vmask turned = g->present & !g->thin & f->turned;
    if (lane_any(turned)) lost = turned ? turned_glass_lost(tables, f, &g->turned, denser) : lost;
#endif
    return greater(lost, splat(1.0e-7f));
}

// What a wall reflects whose boundary reflects that much: to and fro in it.
static vfloat glass_thin(vfloat reflected) { return quotient(reflected * 2.0f, splat(1.0f) + reflected); }

// Everything that follows from the facets, eta and the direction `wo`.
static void glass_prepare(Glass* g, const Facets* f, __global const float* tables, vec3 wo) {
    const vfloat inverse = quotient(splat(1.0f), g->eta);
    const vmask denser = g->eta < 1.0f;
    const vfloat index = denser ? inverse : g->eta, average = fresnel_dielectric_average(index);
    glass_place(g, f, index);
    const vfloat here = glass_lost(g, f, tables, denser), there = g->thin ? here : glass_lost(g, f, tables, !denser);
    // Of diffuse light a smooth boundary passes 1 − F_avg into the denser medium, and 1/n² of that out of it
    const vfloat passes = (splat(1.0f) - average) * (denser ? g->eta * g->eta : splat(1.0f));
    g->passes = g->thin ? splat(1.0f) - glass_thin(average) : quotient(passes * there, greater(here, there));
    g->through = quotient(g->passes, there) * INV_PI;
    g->back = quotient(splat(1.0f) - g->passes, here) * INV_PI;
    g->squeezed = g->thin ? splat(1.0f) : index_radiance(g->eta);
    g->missing = glass_missing(g, f, tables, denser, wo);
}

// What a boundary or a wall reflects at a cosine from the normal, without a film. `beyond`: the cosine on the other side, by Snell's law.
static vfloat glass_fresnel(const Glass* g, vfloat cosine, vfloat* beyond) {
    const vfloat reflected = dielectric_fresnel(cosine, g->eta, beyond);
    return g->thin ? glass_thin(reflected) : reflected;
}

// What passes, from the cosines on both sides, which near total reflection are known better than one from the other, and without the
// difference of 1 and what is reflected: the same bits but for roundings whichever side light comes from.
static vfloat glass_between(vfloat cosine, vfloat beyond, vfloat eta) {
    const vfloat parallel = fma(eta, cosine, beyond), perpendicular = fma(eta, beyond, cosine);
    const vfloat p = quotient(splat(1.0f), parallel), s = quotient(splat(1.0f), perpendicular);
    return eta * cosine * beyond * 2.0f * fma(p, p, s * s);
}

#ifdef IRIDESCENCE
// What passes of each colour where a film lies on it, from the cosines on both sides. A wall is two such boundaries, to and fro.
static vec3 glass_film_passes(const Glass* g, vfloat eta, vfloat cosine, vfloat beyond) {
    const vec3 once = thin_film_boundary(&g->film, eta, cosine, beyond, glass_between(cosine, beyond, eta));
    const vec3 wall = vec3_of(quotient(once.x, splat(2.0f) - once.x), quotient(once.y, splat(2.0f) - once.y), quotient(once.z, splat(2.0f) - once.z));
    return choose(g->thin, wall, once);
}

static vfloat glass_mean(vec3 colors) { return lesser((colors.x + colors.y + colors.z) * (1.0f / 3.0f), splat(1.0f)); }
#endif

// What is reflected of each colour. Bits of a lane without a film do not depend on whether another lane has one.
static vec3 glass_colors(const Glass* g, vfloat cosine) {
    vfloat beyond;
    const vfloat reflected = glass_fresnel(g, cosine, &beyond);
    vec3 colors = vec3_of(reflected, reflected, reflected);
#ifdef IRIDESCENCE
    if (lane_any(g->film.present)) colors = choose(g->film.present, sub(vec3_all(1.0f), glass_film_passes(g, g->eta, cosine, beyond)), colors);
#endif
    return colors;
}

// `between`: the facet normal between `wo` and `wi`, where both are above. The density is that of glass_sample; the diffuse lobes have others.
static vec3 glass_eval(const Glass* g, const Facets* facets, __global const float* tables, vec3 between, vec3 wo, vec3 wi, vfloat* pdf) {
    const Alpha a = facets->alpha;
    const vmask above = wi.z > 0.0f, bent = !above & !g->thin;
    const vfloat cosine = greater(absolute(wi.z), splat(1.0e-7f));
    const vec3 up = vec3_of(wi.x, wi.y, cosine), down = vec3_of(wi.x, wi.y, -cosine);

    // The facet that takes light from one direction to the other
    vec3 wm = between;
    if (lane_any(bent)) wm = choose(bent, unit(along(wo, down, g->eta)), wm);
    wm = choose(wm.z < 0.0f, negate(wm), wm);
    const vfloat in = inner(wo, wm), out = inner(choose(bent, down, up), wm);
    const vfloat near = bounded(absolute(in), 1.0e-7f, 1.0f);
    vfloat far;
    const vfloat reflected = glass_fresnel(g, near, &far);
    far = bent ? bounded(absolute(out), 0.0f, 1.0f) : far;
    vfloat part = above ? reflected : splat(1.0f) - reflected;
    if (lane_any(bent)) part = bent ? glass_between(near, far, g->eta) : part;
#ifdef IRIDESCENCE
    vec3 parts = vec3_all(1.0f);
    if (lane_any(g->film.present)) {
        const vec3 passes = glass_film_passes(g, g->eta, near, far);
        parts = choose(above, sub(parts, passes), passes);
        part = g->film.present ? glass_mean(parts) : part;
    }
#endif

    // From a density of facets to a density of directions (Walter et al., eq. 14 and 17)
    const vfloat stretch = fma(in, quotient(splat(1.0f), g->eta), out);
    const vfloat jacobian = bent ? absolute(in * out) * inverse_or_one(stretch * stretch) : splat(0.25f);
    const vmask lit = (in > 0.0f) & (!bent | (out < 0.0f));
    const vfloat hidden = splat(1.0f) + ggx_lambda(a, wo);
    const vfloat common = lit & g->present ? quotient(part * ggx_distribution(a, wm) * jacobian, wo.z) : splat(0.0f);
    *pdf = quotient(common, hidden);
    vfloat once = quotient(common, (hidden + ggx_lambda(a, up)) * cosine);
    if (lane_any(g->beckmann)) once = g->beckmann ? once * beckmann_over_ggx(a, wo, up, wm) : once;

    // Diffuse lobes
    const vfloat missing = glass_missing(g, facets, tables, above == (g->eta < 1.0f), up);
    const vfloat f = fma(g->missing * missing, above ? g->back : g->through, once);
    vec3 tinted = choose(above, vec3_all(1.0f), scale(g->color, g->squeezed));
#ifdef IRIDESCENCE
    if (lane_any(g->film.present)) {
        const vec3 first = scale(parts, once * inverse_or_one(part)), again = scale(vec3_all(1.0f), f - once);
        tinted = choose(g->film.present, mul(tinted, scale(add(first, again), inverse_or_one(f))), tinted);
    }
#endif
    return choose(g->present, scale(tinted, f * g->share), vec3_all(0.0f));
}

// `w`: which of both ways light goes on from the facet that `u` and `v` choose.
static vec3 glass_sample(const Glass* g, Alpha a, vec3 wo, vfloat u, vfloat v, vfloat w) {
    const vec3 wm = ggx_sample(a, wo, u, v);
    const vfloat cosine = bounded(inner(wo, wm), 0.0f, 1.0f), inverse = quotient(splat(1.0f), g->eta);
    vfloat beyond, reflected = glass_fresnel(g, cosine, &beyond);
#ifdef IRIDESCENCE
    if (lane_any(g->film.present)) {
        const vec3 passes = glass_film_passes(g, g->eta, cosine, beyond);
        reflected = g->film.present ? splat(1.0f) - glass_mean(passes) : reflected;
    }
#endif
    const vmask reflect = w < reflected;
    const vec3 mirrored = sub(scale(wm, cosine * 2.0f), wo);
    const vec3 refracted = along(scale(wo, -inverse), wm, fma(cosine, inverse, -beyond));
    const vec3 passed = choose(g->thin, vec3_of(mirrored.x, mirrored.y, -mirrored.z), refracted);
    // A facet may send light to the wrong side; then it is lost
    const vec3 wi = choose(reflect, mirrored, passed);
    return choose((wi.z > 0.0f) == reflect, wi, vec3_all(0.0f));
}

#endif
