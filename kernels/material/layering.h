// How a material's parameters become the layers of lobes of a closure (material/closure.h): which lobes there are, what they do along `wo`, and
// with what probability each is sampled.
#ifndef MATERIAL_LAYERING_H
#define MATERIAL_LAYERING_H

#include "material/closure.h"
#include "material/parameters.h"

#define LAYERING_SMOOTH 1.0e-3f    // alphas below it make a delta: single precision has no digits left for narrower lobes
#define LAYERING_LEAST_BEND 1.0e-3f // an index closer to 1 bends light by less than single precision resolves
#define LAYERING_LEAST_SHEEN 1.0e-2f
#define LAYERING_LOW 1.5f          // alphas from the horizon, where rough facets lose most of what they lose at first

// The albedos along `wo` of the base's lobes, as if nothing lay on them.
typedef struct {
    vec3 reflection, multiple_reflection;        // of microfacets
    vec3 diffuse, diffuse_transmission;
    vec3 glass;
    vfloat glass_single, glass_multiple_reflection, glass_multiple_transmission;
} BaseAlbedos;

static vfloat layering_mean(vec3 v) { return (v.x + v.y + v.z) * (1.0f / 3.0f); }

// Metal, and the layer above a diffuse surface: by Fresnel's equations, or by Schlick's approximation for its index (glTF,
// KHR_materials_specular). `metallic`, `plastic`: shares of the base.
static void layering_reflection(const Parameters* p, vmask lit, vfloat metallic, vfloat plastic, vfloat clear, Closure* c) {
    const vmask layered = p->kind == MATERIAL_PRINCIPLED, metal = p->kind == MATERIAL_CONDUCTOR;
    const vfloat one = splat(1.0f), ratio = quotient(p->ior - 1.0f, p->ior + 1.0f);
    const vec3 tint = scale(p->specular_color, ratio * ratio);
    const vec3 f0 = scale(vec3_of(lesser(tint.x, one), lesser(tint.y, one), lesser(tint.z, one)), p->specular);
    const vec3 f90 = vec3_of(p->specular, p->specular, p->specular);
    Reflection* r = &c->reflection;
    r->present = lit & ((layered & (clear < 1.0f)) | (metal & (p->roughness * p->roughness >= LAYERING_SMOOTH)));
    r->measured = metal & !parameters_flag(p, MATERIAL_FLAG_SCHLICK);
    r->beckmann = parameters_flag(p, MATERIAL_FLAG_BECKMANN) & r->present;
    r->f0 = choose(r->measured, p->eta, along(scale(p->color, metallic), f0, plastic));
    r->f90 = choose(r->measured, p->k, along(vec3_of(metallic, metallic, metallic), f90, plastic));
    r->multiple = r->f0;
    r->missing = splat(0.0f);
    Diffuse* d = &c->diffuse;
    d->f0 = f0, d->f90 = f90;
#ifdef IRIDESCENCE
    r->metal = p->color;
    r->layer_f0 = f0, r->layer_f90 = f90;
    r->metallic = metallic, r->layered = plastic;
#endif
}

#ifdef IRIDESCENCE
// The film, as it is seen from this side. `inside`: of what light passes into.
static void layering_film(const Scene* scene, const Parameters* p, vmask lit, vmask inside, ThinFilm* film) {
    film->tables = scene->thin_film_rows;
    film->present = lit & (p->film_share > 0.0f) & (p->film_thickness > 0.0f);
    film->share = p->film_share;
    film->ior = inside ? quotient(p->film_ior, p->ior) : p->film_ior;
    film->way = p->film_thickness * p->film_index * 2.0f;
#ifdef SPECTRAL
    film->lines = scene->wavelengths.lines;
#endif
}
#endif

static void layering_diffuse(const Parameters* p, vmask lit, vfloat plastic, Diffuse* d) {
    const vmask layered = p->kind == MATERIAL_PRINCIPLED;
    d->present = lit & ((p->kind == MATERIAL_OREN_NAYAR) | (plastic > 0.0f));
    d->covered = layered;
    d->color = p->color;
    d->share = layered ? plastic : splat(1.0f);
    d->transmission = p->diffuse_transmission;
    d->transmission_color = p->diffuse_transmission_color;
    d->roughness = p->diffuse_roughness;
    d->transmitted = vec3_all(1.0f);
    d->corrected = mask_none();
}

// `clear`: its share of the base. Where it bends nothing, its facets would have no direction.
static void layering_glass(const Parameters* p, vmask lit, vmask front, vfloat clear, const Facets* facets, Glass* g) {
    const vfloat one = splat(1.0f);
    const vmask layered = p->kind == MATERIAL_PRINCIPLED, thin = parameters_flag(p, MATERIAL_FLAG_THIN);
    g->thin = thin;
    g->beckmann = parameters_flag(p, MATERIAL_FLAG_BECKMANN) & (p->kind == MATERIAL_DIELECTRIC);
    g->base = facets->base;
    const vfloat ior = thin & (p->ior < 1.0f) ? quotient(one, p->ior) : p->ior, turned = front | thin ? ior : quotient(one, ior);
    const vfloat least = turned < 1.0f ? splat(1.0f - LAYERING_LEAST_BEND) : splat(1.0f + LAYERING_LEAST_BEND);
    const vmask straight = absolute(turned - 1.0f) < LAYERING_LEAST_BEND;
    g->eta = straight ? least : turned;
    g->present = lit & (clear > 0.0f) & (layered | ((p->roughness * p->roughness >= LAYERING_SMOOTH) & (thin | !straight)));
    g->color = p->color;
    g->share = clear;
    g->alpha = facets->mean;
    g->missing = g->passes = g->back = g->through = g->squeezed = splat(0.0f);
}

// Which lobes there are, and their numbers as far as they do not depend on `wo`. `front`: seen from the front.
static void layering_lobes(const Scene* scene, const Parameters* p, vmask front, Closure* c) {
    c->tables = scene->albedo_tables;
    const vmask layered = p->kind == MATERIAL_PRINCIPLED, metal = p->kind == MATERIAL_CONDUCTOR, glass = p->kind == MATERIAL_DIELECTRIC;
    const vmask thin = parameters_flag(p, MATERIAL_FLAG_THIN), lit = front | !parameters_flag(p, MATERIAL_FLAG_ONE_SIDED);
    const vfloat none = splat(0.0f), one = splat(1.0f);
    c->facets = facets_of(p->roughness * p->roughness, LAYERING_SMOOTH, p->anisotropy, parameters_flag(p, MATERIAL_FLAG_BECKMANN));

    // The base: shares of metal, of glass, and of what is neither
    const vfloat metallic = layered ? p->metallic : metal ? one : none;
    const vfloat clear = layered ? (one - metallic) * p->transmission : glass ? one : none;
    const vfloat plastic = layered ? greater(one - metallic - clear, none) : none;
    layering_reflection(p, lit, metallic, plastic, clear, c);
    layering_diffuse(p, lit, plastic, &c->diffuse);
    layering_glass(p, lit, front, clear, &c->facets, &c->glass);
#ifdef IRIDESCENCE
    layering_film(scene, p, lit, mask_none(), &c->reflection.film);
    layering_film(scene, p, lit, !thin & !front, &c->glass.film);
#endif

    // Sheen and coat
    c->inside = (clear > 0.0f) & !thin & !front;
    c->sheen.present = layered & lit & (p->sheen_most > 0.0f);
    c->sheen.color = p->sheen_color;
    c->sheen.most = p->sheen_most;
    c->sheen.alpha = greater(p->sheen_roughness * p->sheen_roughness, splat(LAYERING_LEAST_SHEEN));
    c->sheen.scale = c->sheen.hidden = none;
    c->coat.present = layered & lit & (p->coat > 0.0f);
    c->coat.share = p->coat;
    c->coat.alpha = greater(p->coat_roughness * p->coat_roughness, splat(LAYERING_SMOOTH));
    c->coated.present = c->clothed.present = mask_none();
    c->metal = vec3_all(0.0f);
    c->present = c->reflection.present | c->diffuse.present | c->glass.present | c->sheen.present | c->coat.present;
#ifdef SPECTRAL
    c->scene = scene;
#endif
#ifdef HAIR
    c->hair.present = p->kind == MATERIAL_HAIR;
    c->present = c->present | c->hair.present;
#endif
#ifdef MEASURED
    c->measured.present = lit & (p->kind == MATERIAL_MEASURED);
    c->present = c->present | c->measured.present;
#endif
#ifdef PLUGIN_BSDFS
    c->plugin = lit ? p->plugin : splat_uint(0u);
    for (int i = 0; i < PLUGIN_NUMBERS; ++i) c->numbers[i] = p->numbers[i];
    c->present = c->present | (c->plugin != 0u);
#endif
}

// Sheen and coat as covers of a diffuse surface.
static Covers layering_covers(const Closure* c) {
    const vfloat none = splat(0.0f), one = splat(1.0f);
    Covers over;
    over.sheen_average = over.coat_average = one;
    over.sheen.b = over.sheen.c = over.coat.b = over.coat.c = none;
    if (lane_any(c->sheen.present & !c->inside)) {
        const vmask there = c->sheen.present & !c->inside;
        const vfloat most = c->sheen.most, mean = albedo_line(c->tables, splat_uint(ALBEDO_SHEEN_MEAN), SHEEN_ROWS, c->sheen.alpha);
        const vfloat average = fma(-most, mean, one), share = there ? quotient(most, average) : none;
        over.sheen_average = there ? average * fma(most * c->diffuse.roughness, quotient(splat(DIFFUSE_SHEEN_SLACK), c->sheen.alpha), one) : one;
        const Slant s = albedo_sheen_slant(c->tables, c->sheen.alpha);
        over.sheen.b = s.b * share, over.sheen.c = s.c * share;
    }
    if (lane_any(c->coat.present & !c->inside)) {
        const vmask there = c->coat.present & !c->inside;
        over.coat_average = there ? one - coat_average(&c->coat, c->tables) : one;
        const vfloat share = there ? quotient(c->coat.share, over.coat_average) : none;
        const vuint ggx = splat_uint(0u);
        const Slant e = albedo_facets_slant(c->tables, ggx, 0u, c->coat.alpha), g = albedo_facets_slant(c->tables, ggx, 1u, c->coat.alpha);
        over.coat.b = fma(g.b, splat(1.0f - COAT_F0), e.b * COAT_F0) * share;
        over.coat.c = fma(g.c, splat(1.0f - COAT_F0), e.c * COAT_F0) * share;
    }
    return over;
}

#ifdef IRIDESCENCE
// Means over the cosine-weighted hemisphere: of what a metal below a film reflects, and, added, of what the film adds to the layer's albedo. Gauss' rule in
// the squared cosine.
#define LAYERING_FILM_NODES 6
__constant float LAYERING_FILM_COSINES[LAYERING_FILM_NODES] = {0.18375321f, 0.41157661f, 0.61700114f, 0.78696226f, 0.91137517f, 0.98297241f};
__constant float LAYERING_FILM_WEIGHTS[LAYERING_FILM_NODES] = {0.08566225f, 0.18038079f, 0.23395697f, 0.23395697f, 0.18038079f, 0.08566225f};

static void layering_film_averages(const Closure* c, const Parameters* p, vec3* metal, vec3* layer) {
    const Reflection* r = &c->reflection;
    const vec3 one = vec3_all(1.0f);
    vec3 metals = vec3_all(0.0f), layers = vec3_all(0.0f);
    for (int i = 0; i < LAYERING_FILM_NODES; ++i) {
        const vfloat cosine = splat(LAYERING_FILM_COSINES[i]), weight = splat(LAYERING_FILM_WEIGHTS[i]);
        vec3 seen = thin_film_schlick(&r->film, p->color, one, cosine);
        if (lane_any(r->measured)) {
            const vec3 bare = fresnel_metal(r->f0, r->f90, cosine);
            seen = choose(r->measured, thin_film_reflects(&r->film, r->f0, r->f90, cosine, bare), seen);
        }
        metals = along(metals, seen, weight);
        const vfloat albedo = albedo_even(c->tables, c->facets.base, c->facets.mean, cosine);
        layers = along(layers, closure_film_adds(c, c->facets.mean, albedo, cosine), weight);
    }
    *metal = choose(r->film.present, metals, *metal);
    *layer = choose(r->film.present, add(*layer, layers), *layer);
}
#endif

// Along `wo`: reflection, and what it leaves to a diffuse surface.
static void layering_reflect(Closure* c, const Parameters* p, vec3 wo, BaseAlbedos* e) {
    Reflection* r = &c->reflection;
    const vfloat albedo = albedo_facets(c->tables, &c->facets, wo), lost = albedo_facets_lost(c->tables, &c->facets);
    const vfloat grazing = albedo_grazing(c->tables, c->facets.base, albedo_seen(&c->facets, wo), wo.z);
    vec3 average = choose(r->measured, p->fresnel, fresnel_schlick_average(p->color, vec3_all(1.0f)));
    vec3 reflected = diffuse_layer_average(&c->diffuse, c->tables, &c->facets, splat(1.0f) - lost);
#ifdef IRIDESCENCE
    if (lane_any(r->film.present)) layering_film_averages(c, p, &average, &reflected);
#endif
    const vfloat metallic = p->kind == MATERIAL_CONDUCTOR ? splat(1.0f) : p->metallic;
    const vmask below_coat = c->coat.present & (metallic > 0.0f), below_sheen = c->sheen.present & (metallic > 0.0f);
    if (lane_any(below_coat | below_sheen)) {
        c->metal = scale(average, metallic);
        c->coated = covered_by(c->tables, COVERED_BY_COAT, below_coat, c->coat.share, c->coat.alpha, c->facets.mean, wo.z);
        c->clothed = covered_by(c->tables, COVERED_BY_SHEEN, below_sheen, c->sheen.most, c->sheen.alpha, c->facets.mean, wo.z);
    }
    r->missing = parameters_flag(p, MATERIAL_FLAG_SINGLE_SCATTERING) ? splat(0.0f) : splat(1.0f) - albedo;
    r->multiple = scale(reflection_multiple(average, lost), metallic);
    const vec3 f0 = choose(r->measured, p->color, r->f0), f90 = choose(r->measured, vec3_all(1.0f), r->f90);
    vec3 seen = along(scale(f0, albedo), sub(f90, f0), albedo * grazing);
#ifdef IRIDESCENCE
    if (lane_any(r->film.present)) {
        const ThinFilmFacets facets = thin_film_facets(&r->film, albedo_seen(&c->facets, wo), wo.z);
        const vec3 low = reflection_fresnel(r, facets.low), high = reflection_fresnel(r, facets.high);
        seen = choose(r->film.present, scale(along(low, sub(high, low), facets.second), albedo), seen);
    }
#endif
    e->reflection = choose(r->present, seen, e->reflection);
    e->multiple_reflection = choose(r->present, scale(r->multiple, r->missing * lost * PI), e->multiple_reflection);
    if (lane_any(c->diffuse.present & c->diffuse.covered)) {
        Diffuse* d = &c->diffuse;
        const Covers over = layering_covers(c);
        const vec3 layer = closure_layer_albedo(c, albedo, grazing, wo);
        diffuse_cover(d, &over, c->tables, &c->facets, reflected, layer, c->transmittance, wo.z);
        const vec3 left = choose(d->covered, sub(vec3_all(1.0f), layer), vec3_all(1.0f));
        e->diffuse = choose(d->present, scale(mul(d->color, left), diffuse_share(d, mask_all())), e->diffuse);
        e->diffuse_transmission = choose(d->present, scale(mul(d->transmission_color, left), diffuse_share(d, mask_none())), e->diffuse_transmission);
    }
}

// Along `wo`: glass.
static void layering_refract(Closure* c, const Parameters* p, vec3 wo, BaseAlbedos* e) {
    Glass* g = &c->glass;
    glass_prepare(g, &c->facets, c->tables, wo);
    g->missing = parameters_flag(p, MATERIAL_FLAG_SINGLE_SCATTERING) ? splat(0.0f) : g->missing;
    const vfloat share = g->present ? g->share : splat(0.0f);
    const vec3 back = glass_colors(g, wo.z);
    e->glass_single = share * (splat(1.0f) - g->missing);
    e->glass_multiple_reflection = share * g->missing * (splat(1.0f) - g->passes);
    e->glass_multiple_transmission = share * g->missing * g->passes;
    e->glass = scale(add(back, mul(g->color, sub(vec3_all(1.0f), back))), share);
}

// Lobes are sampled about as often as they scatter light along `wo`; what scatters none, by the cosine. `coat` and `sheen`: albedos.
static void layering_probabilities(Closure* c, const BaseAlbedos* e, vfloat coat, vfloat sheen, vec3 wo) {
    // Rough diffuse surfaces seen at grazing angles scatter over their cosine towards the horizon (EON)
    const vfloat uniform = c->diffuse.present ? c->diffuse.roughness * 0.5f * fresnel_grazing(wo.z) : splat(0.0f);
    const vfloat diffuse = layering_mean(e->diffuse) * c->transmittance;
    LobeProbabilities* p = &c->probability;
    p->coat = coat;
    p->uniform = fma(diffuse, uniform, c->sheen.most * sheen);
    p->reflection = layering_mean(e->reflection) * c->transmittance;
    p->glass = e->glass_single * c->transmittance;
    p->multiple_transmission = e->glass_multiple_transmission * c->transmittance;
    p->multiple_reflection = (layering_mean(e->multiple_reflection) + e->glass_multiple_reflection) * c->transmittance;
    p->diffuse = diffuse * (splat(1.0f) - uniform);
    p->diffuse_transmission = layering_mean(e->diffuse_transmission) * c->transmittance;
    const vfloat facets = p->coat + p->uniform + p->reflection + p->glass + p->multiple_transmission + p->multiple_reflection;
    const vfloat sum = facets + p->diffuse + p->diffuse_transmission, inverse = inverse_or_one(sum);
    p->coat = p->coat * inverse, p->uniform = p->uniform * inverse, p->reflection = p->reflection * inverse, p->glass = p->glass * inverse;
    p->multiple_transmission = p->multiple_transmission * inverse, p->multiple_reflection = p->multiple_reflection * inverse;
    p->diffuse = sum > 0.0f ? p->diffuse * inverse : splat(1.0f);
    p->diffuse_transmission = p->diffuse_transmission * inverse;
    c->low2 = c->octaves = splat(1.0f);
    if (lane_any((p->multiple_reflection > 0.0f) | (p->multiple_transmission > 0.0f))) {
        // Within glass of an index near 1 most light is lost near the horizon; metals lose it more evenly
        const vfloat eta = c->glass.eta, bends = c->glass.present & !c->glass.thin ? absolute(quotient(eta - 1.0f, eta + 1.0f)) : splat(1.0f);
        const vfloat low = c->facets.mean * fma(bends * c->facets.mean, splat(12.0f), splat(LAYERING_LOW));
        c->low2 = low * low;
        c->octaves = log2_of(splat(1.0f) + quotient(splat(1.0f), c->low2));
    }
}

static void closure_at(const Scene* scene, const Parameters* p, vec3 wo, vmask front, Closure* c) {
    layering_lobes(scene, p, front, c);
    c->least_alpha = c->coat.present ? lesser(c->facets.alpha.y, c->coat.alpha) : c->facets.alpha.y;
    c->transmittance = c->inside ? splat(1.0f) : closure_transmittance(c, wo.z);

    BaseAlbedos e;
    e.reflection = e.multiple_reflection = e.diffuse = e.diffuse_transmission = e.glass = vec3_all(0.0f);
    e.glass_single = e.glass_multiple_reflection = e.glass_multiple_transmission = splat(0.0f);
    if (lane_any(c->reflection.present)) layering_reflect(c, p, wo, &e);
    e.diffuse = choose(c->diffuse.present & !c->diffuse.covered, c->diffuse.color, e.diffuse);
    if (lane_any(c->glass.present)) layering_refract(c, p, wo, &e);

    vfloat coat = splat(0.0f), sheen = splat(0.0f);
    if (lane_any(c->coat.present)) coat = c->inside ? splat(0.0f) : coat_albedo(&c->coat, c->tables, wo.z);
    if (lane_any(c->sheen.present)) {
        c->sheen.scale = albedo_line(c->tables, splat_uint(ALBEDO_SHEEN_SCALE), SHEEN_ROWS, c->sheen.alpha);
        c->sheen.hidden = sheen_hidden(&c->sheen, wo.z);
        sheen = c->sheen.present & !c->inside ? sheen_albedo(&c->sheen, c->tables, wo.z) * (splat(1.0f) - coat) : splat(0.0f);
    }
    const vec3 base = add(add(e.reflection, add(e.multiple_reflection, e.diffuse)), add(e.glass, e.diffuse_transmission));
    const vec3 albedo = add(add(vec3_of(coat, coat, coat), scale(c->sheen.color, sheen)), scale(base, c->transmittance));
    c->albedo = choose(c->present, albedo, vec3_all(0.0f));
#ifdef HAIR
    if (lane_any(c->hair.present)) {
        hair_prepare(&p->hair, p->color, wo, c->hair.present, &c->hair);
        c->albedo = choose(c->hair.present, hair_albedo(&c->hair), c->albedo);
    }
#endif
#ifdef MEASURED
    if (lane_any(c->measured.present)) {
        measured_prepare(scene->measured_rows, scene->measured_words, p->measured, wo, c->measured.present, &c->measured);
        c->albedo = choose(c->measured.present, closure_at_wavelengths(c, c->measured.albedo), c->albedo);
    }
#endif
#ifdef PLUGIN_BSDFS
    const vmask given = c->plugin != 0u;
    if (lane_any(given)) c->albedo = choose(given, closure_at_wavelengths(c, plugin_albedo(c->plugin, c->numbers, wo)), c->albedo);
#endif
    layering_probabilities(c, &e, coat, sheen, wo);
}

#endif
