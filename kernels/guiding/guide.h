// Guided paths: directions by the guiding field beside those of the BSDF, and roulette by what the field says that a path will bring.
//
// Directions are of a mixture: with the share of the cell from its histogram, else from the BSDF; weights are by the mixture's density (the one-sample
// model of Veach and Guibas 1995), which light samples at the vertex are weighed with too (Müller, Gross and Novák 2017). A path goes on with the
// probability that it is worth it: what it is expected to bring, relative to what was expected where it first met the field (Vorba and Křivánek 2016).
// Whatever the field says, each is unbiased, and no weight grows by much more than GUIDE_MOST_WEIGHT beyond that of a path which is not guided.
//
// Without PATH_GUIDED all of this is nothing, and paths are those of the BSDF.
#ifndef GUIDING_GUIDE_H
#define GUIDING_GUIDE_H

#include "core/quotient.h"
#include "core/roulette.h"
#include "integrator/path_state.h"
#include "integrator/vertex.h"
#include "material/bsdf.h"

#ifdef PATH_GUIDED

#define GUIDE_LEAST_SURVIVAL 0.25f
#define GUIDE_SURVIVAL_SCALE 2.0f
#define GUIDE_MOST_WEIGHT 4.0f

#ifdef SPECTRAL
static vfloat guide_luminance(vec3 at_wavelengths) { return (at_wavelengths.x + at_wavelengths.y + at_wavelengths.z) * (1.0f / 3.0f); }
#else
static vfloat guide_luminance(vec3 color) { return fma(color.x, splat(0.2126f), fma(color.y, splat(0.7152f), color.z * 0.0722f)); }
#endif

// The paths whose weight guiding has let grow so much that it may not grow any more: directions of the BSDF and paths that are not ended keep it.
static vmask guide_is_heavy(const Path* path) { return largest(path->throughput) * path->index_squared > GUIDE_MOST_WEIGHT; }

// What the field knows of each path's vertex.
static void guide_look_up(const Scene* scene, Path* path, Vertex* v) {
    const Field* field = &scene->field;
    Guide* guide = &v->guide;
    const vmask medium = bsdf_in_medium(&v->bsdf);
    guide->asked = v->samples_lights & !bsdf_passes(&v->bsdf);
    guide->place = field_place(field, v->surface.point, medium ? splat_uint(FIELD_FACE_MEDIUM) : field_face(v->bsdf.side), guide->asked);
    const vuint at = guide->asked ? guide->place : splat_uint(0u), cell = LANE_LOOK_UP(uint, field->nodes, at);
    const vmask known = guide->asked & (cell != NONE);
    guide->cell = known ? cell : splat_uint(0u);
    const vmask guides = known & !guide_is_heavy(path);
    guide->share = guides ? field_number(field, guide->cell, FIELD_ROW_GUIDED) : splat(0.0f);
    guide->light = guides ? field_number(field, guide->cell, FIELD_ROW_LIGHT) : splat(1.0f);
    guide->reflected = known ? field_number(field, guide->cell, FIELD_ROW_REFLECTED) : splat(0.0f);
    guide->albedo = medium ? splat(1.0f) : guide_luminance(bsdf_albedo(&v->bsdf));
    guide->throughput = path->throughput;
    guide->index_squared = path->index_squared;
    guide->event = path->depth;
    const vmask first = known & (path->expected == 0.0f);
    if (!lane_any(first)) return;
    const vfloat outgoing = guide_luminance(path->throughput) * guide->albedo * field_number(field, guide->cell, FIELD_ROW_OUTGOING);
    path->expected = first ? outgoing : path->expected;
}

// Where light samples are taken: more seldom where training found that they bring little. What they bring then counts for as much more.
static vmask guide_takes_light(const Path* path, const Vertex* v) {
    const vmask seldom = v->guide.light < 1.0f;
    if (!lane_any(seldom)) return mask_all();
    vuint unused, choice;
    sampler_hash_bits(path->sample.sampler, sampler_set(path->depth, SET_SPARE), &unused, &choice);
    return !seldom | (unit_interval(choice) < v->guide.light);
}
static vfloat guide_light_weight(const Vertex* v) { return quotient(splat(1.0f), v->guide.light); }

// The density of a direction, if the BSDF has it with this one.
static vfloat guide_pdf(const Scene* scene, const Vertex* v, vec3 direction, vfloat bsdf_pdf) {
    const vmask guided = v->guide.share > 0.0f;
    if (!lane_any(guided)) return bsdf_pdf;
    return guided ? fma(v->guide.share, field_pdf(&scene->field, v->guide.cell, direction) - bsdf_pdf, bsdf_pdf) : bsdf_pdf;
}

// Choose whose direction the path goes on in; what is left of the random bits are those of the direction, so that it stays as well distributed. Shares
// are multiples of a quarter.
static void guide_choose(Vertex* v, vuint* bits) {
    Guide* guide = &v->guide;
    const vuint quarters = vuint_of(vint_of(guide->share * 4.0f));
    guide->chosen = (*bits >> 30) < quarters;
    if (!lane_any(quarters > 0u)) return;
    const vuint rest = guide->chosen ? *bits : *bits - (quarters << 30), of = guide->chosen ? quarters : 4u - quarters;
    const vuint three = rest + mul_hi(rest, splat_uint(0x55555556u));
    *bits = of == 1u ? rest << 2 : (of == 2u ? rest << 1 : (of == 3u ? three : rest));
}

// Put directions of the field in place of some of the BSDF's, and weigh both by the mixture. Both are of the bits u and v.
static void guide_sample(const Scene* scene, Vertex* v, vuint bits_u, vuint bits_v, BsdfSample* next) {
    Guide* guide = &v->guide;
    guide->bsdf_pdf = next->pdf;
    const vmask guided = guide->share > 0.0f, chosen = guide->chosen;
    if (!lane_any(guided)) return;
    const vec3 direction = field_sample(&scene->field, guide->cell, bits_u, bits_v);
    vfloat pdf;
    const vec3 f_cosine = bsdf_eval(&v->bsdf, direction, &pdf);
    next->direction = choose(chosen, direction, next->direction);
    guide->bsdf_pdf = chosen ? pdf : guide->bsdf_pdf;
    const vfloat mixed = guide_pdf(scene, v, next->direction, guide->bsdf_pdf), inverse = inverse_or_one(mixed);
    const vec3 weight = choose(chosen, scale(f_cosine, inverse), scale(next->weight, next->pdf * inverse));
    next->weight = choose(guided, weight, next->weight);
    next->pdf = guided ? mixed : next->pdf;
}

// The probability that a path goes on after its event. Where the field does not know what to expect, paths survive as their event's weight says, and
// those that have not met the field at all, by their throughput. The first two events have none: roulette's random numbers would undo the stratification.
static vfloat guide_survival(const Scene* scene, const Path* path, const Vertex* v) {
    const vfloat plain = path_survival(scene, path, path->throughput, path->depth, v->surface.termination);
    if (scene->settings->roulette != ROULETTE_THROUGHPUT) return plain;
    const Guide* guide = &v->guide;
    const vfloat carried = guide_luminance(guide->throughput) * guide->albedo * guide->reflected * GUIDE_SURVIVAL_SCALE;
    const vfloat worth = bounded(carried * inverse_or_one(path->expected), GUIDE_LEAST_SURVIVAL, 1.0f);
    const vfloat after = largest(path->throughput) * path->index_squared, before = largest(guide->throughput) * guide->index_squared;
    const vfloat weight = lesser(after * inverse_or_one(before), splat(1.0f));
    const vfloat by_field = guide->event < 2u ? splat(1.0f) : guide->reflected > 0.0f ? worth : guide->event >= 4u ? weight : splat(1.0f);
    const vfloat survival = guide_is_heavy(path) ? splat(1.0f) : by_field;
    return path->expected > 0.0f ? survival * roulette_late(path->depth) : plain;
}

#else

static void guide_look_up(const Scene* scene, Path* path, Vertex* v) {}
static vmask guide_takes_light(const Path* path, const Vertex* v) { return mask_all(); }
static vfloat guide_light_weight(const Vertex* v) { return splat(1.0f); }
static vfloat guide_pdf(const Scene* scene, const Vertex* v, vec3 direction, vfloat bsdf_pdf) { return bsdf_pdf; }
static void guide_choose(Vertex* v, vuint* bits) {}
static void guide_sample(const Scene* scene, Vertex* v, vuint bits_u, vuint bits_v, BsdfSample* next) {}
static vfloat guide_survival(const Scene* scene, const Path* path, const Vertex* v) {
    return path_survival(scene, path, path->throughput, path->depth, v->surface.termination);
}

#endif

#endif
