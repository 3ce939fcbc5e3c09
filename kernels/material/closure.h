// What a point scatters light with: layers of lobes.
//
// A coat lies on sheen, and sheen on the base, which is a mixture of metal, glass, and a diffuse surface below a reflecting layer. With
// E(μ) the directional albedo of a layer, T(μ) = 1 − E(μ) what it transmits, and T(μo, μi) the lesser of T(μo) and T(μi),
//
//     f = f_coat + T_coat f_sheen + T_coat,sheen (f_reflection + f_glass) + f_diffuse + f_covered.
//
// The lesser of both is reciprocal and never gains energy (glTF, KHR_materials_sheen), but it loses some. f_covered returns what metal loses
// so (lobe/covered.h); f_diffuse has T of all layers as a product instead, which loses nothing (lobe/diffuse.h). E comes from tables
// (albedo.h). A direction is sampled by one of eight ways, each with its lobe probability.
//
// Frame: local, z = shading normal on the side of `wo`. Directions point away from the surface. eval: f in 1/sr, without the cosine.
// pdf: per steradian, of all the ways together in which closure_sample may choose a direction.
#ifndef MATERIAL_CLOSURE_H
#define MATERIAL_CLOSURE_H

#include "core/warp.h"
#include "material/lobe/coat.h"
#include "material/lobe/covered.h"
#include "material/lobe/diffuse.h"
#include "material/lobe/glass.h"
#ifdef HAIR
#include "material/lobe/hair.h"
#endif
#ifdef MEASURED
#include "material/lobe/measured.h"
#endif
#include "material/lobe/reflection.h"
#include "material/lobe/sheen.h"
#include "plugin/given.h"
#include "spectral/color.h"

// With what probability each way of sampling is chosen; sum 1. Multiple: what more than one facet scatters, to this side or the other.
// Uniform: over the hemisphere, for sheen and for rough diffuse surfaces at grazing angles.
typedef struct {
    vfloat diffuse, diffuse_transmission, uniform, reflection, glass, multiple_reflection, multiple_transmission, coat;
} LobeProbabilities;

typedef struct {
    __global const float* tables;
    vmask present;           // the lobes below are all that the point scatters with; else it is what Bsdf says
    Facets facets;           // of the base
    Diffuse diffuse;
    Reflection reflection;
    Glass glass;
    Sheen sheen;
    Coat coat;
    Covered coated, clothed; // metal below the coat, and below sheen
    vec3 metal;              // its average albedo, times its share of the base
    vmask inside;            // seen from within a solid: coat and sheen lie on the other side
    vfloat transmittance;    // T(μo) of coat and sheen; 1 where they lie on the other side
    vfloat least_alpha;      // of all facets
    vec3 albedo;             // about the share of light along `wo` that is reflected or transmitted
    LobeProbabilities probability;
    vfloat low2, octaves;    // of warp_low_hemisphere, for what more than one facet scatters
#ifdef HAIR
    Hair hair;               // scatters in the place of all lobes, where it is present
#endif
#ifdef SPECTRAL
    const Scene* scene;      // for what scatters colors
#endif
#ifdef MEASURED
    Measured measured;       // likewise
#endif
#ifdef PLUGIN_BSDFS
    vuint plugin;            // what scatters in the place of all lobes; 0: nothing does
    vfloat numbers[PLUGIN_NUMBERS];
#endif
} Closure;

// Of what scatters colors, such as a table of red, green and blue: at the lanes' wavelengths.
static vec3 closure_at_wavelengths(const Closure* c, vec3 color) {
#ifdef SPECTRAL
    return color_unbounded(c->scene, color);
#else
    return color;
#endif
}

// Where light goes to the other side, or comes from there.
static vmask closure_passes(const Closure* c) {
    vmask passes = c->present & (c->glass.present | (c->diffuse.present & (c->diffuse.transmission > 0.0f)));
#ifdef HAIR
    passes = passes | c->hair.present;
#endif
#ifdef PLUGIN_BSDFS
    const vmask given = plugin_transmits(c->plugin);
    if (lane_any(given)) passes = passes | given;
#endif
    return passes;
}

// What is not reciprocal.
static vmask closure_is_one_way(const Closure* c) {
    vmask one_way = mask_none();
#ifdef MEASURED
    one_way = one_way | c->measured.present;
#endif
#ifdef HAIR
    one_way = one_way | c->hair.present;
#endif
    return one_way;
}

// T(μ) of coat and sheen.
static vfloat closure_transmittance(const Closure* c, vfloat cosine) {
    vfloat left = splat(1.0f);
    if (lane_any(c->sheen.present)) {
        const vfloat taken = c->sheen.most * sheen_albedo(&c->sheen, c->tables, cosine);
        left = c->sheen.present ? splat(1.0f) - taken : left;
    }
    if (lane_any(c->coat.present)) left = left * (splat(1.0f) - coat_albedo(&c->coat, c->tables, cosine));
    return left;
}

// T(μo, μi) of sheen alone, and of the coat alone.
static vfloat closure_below_sheen(const Closure* c, vfloat out, vfloat in) {
    if (!lane_any(c->sheen.present)) return splat(1.0f);
    const vfloat most = c->sheen.most, taken = greater(sheen_albedo(&c->sheen, c->tables, out), sheen_albedo(&c->sheen, c->tables, in));
    return c->sheen.present ? fma(-most, taken, splat(1.0f)) : splat(1.0f);
}
static vfloat closure_below_coat(const Closure* c, vfloat out, vfloat in) {
    return lesser(splat(1.0f) - coat_albedo(&c->coat, c->tables, out), splat(1.0f) - coat_albedo(&c->coat, c->tables, in));
}

// f_coat + T_coat f_sheen + T_coat,sheen `f` + f_covered, where `f` is that of reflection and glass; `transmittance`: T(μi) of coat and sheen.
// `wm`: the normal between both directions; `up`: `wi`, on the side of `wo`.
static vec3 closure_eval_layers(const Closure* c, vec3 base, vec3 wm, vec3 wo, vec3 up, vmask above, vfloat transmittance, vfloat* density) {
    const vmask on_layers = above & !c->inside, leaves_solid = !above & !c->glass.thin;
    const vfloat within = above ? splat(1.0f) : transmittance, both = lesser(c->transmittance, transmittance);
    vec3 f = scale(base, c->inside ? within : leaves_solid ? c->transmittance : both);
    if (lane_any(c->sheen.present)) {
        const vfloat below_coat = closure_below_coat(c, wo.z, up.z);
        if (lane_any(c->clothed.present)) f = along(f, c->metal, on_layers ? below_coat * covered_eval(&c->clothed, c->tables, up.z) : splat(0.0f));
        f = choose(on_layers, add(f, scale(sheen_eval(&c->sheen, wo, up), below_coat)), f);
    }
    if (lane_any(c->coat.present)) {
        vfloat pdf;
        const vfloat shine = coat_eval(&c->coat, wm, wo, up, &pdf);
        if (lane_any(c->coated.present)) f = along(f, c->metal, on_layers ? closure_below_sheen(c, wo.z, up.z) * covered_eval(&c->coated, c->tables, up.z) : splat(0.0f));
        f = choose(on_layers, add(f, vec3_of(shine, shine, shine)), f);
        *density = above ? fma(c->probability.coat, pdf, *density) : *density;
    }
    return f;
}

#ifdef IRIDESCENCE
// About what a film adds to the albedo of the layer above a diffuse surface.
static vec3 closure_film_adds(const Closure* c, vfloat alpha, vfloat albedo, vfloat cosine) {
    const ThinFilm* film = &c->reflection.film;
    const vec3 f0 = c->diffuse.f0, f90 = c->diffuse.f90;
    const ThinFilmFacets facets = thin_film_facets(film, alpha, cosine);
    const vec3 low = sub(thin_film_schlick(film, f0, f90, facets.low), fresnel_schlick(f0, f90, facets.low));
    const vec3 high = sub(thin_film_schlick(film, f0, f90, facets.high), fresnel_schlick(f0, f90, facets.high));
    return scale(along(low, sub(high, low), facets.second), albedo);
}
#endif

// E of the layer above a diffuse surface, of a direction with that albedo of its facets.
static vec3 closure_layer_albedo(const Closure* c, vfloat albedo, vfloat grazing, vec3 w) {
    const vec3 layer = diffuse_layer_albedo(&c->diffuse, albedo, grazing);
#ifdef IRIDESCENCE
    const vmask filmed = c->reflection.film.present & c->diffuse.covered;
    if (lane_any(filmed)) {
        const vfloat alpha = albedo_seen(&c->facets, w);
        const vec3 whole = add(layer, closure_film_adds(c, alpha, albedo, w.z));
        return choose(filmed, vec3_of(bounded(whole.x, 0.0f, 1.0f), bounded(whole.y, 0.0f, 1.0f), bounded(whole.z, 0.0f, 1.0f)), layer);
    }
#endif
    return layer;
}

// f, and the density.
static vec3 closure_eval(const Closure* c, vec3 wo, vec3 wi, vfloat* pdf) {
    const LobeProbabilities* probability = &c->probability;
    const vmask above = wi.z > 0.0f;
    const vfloat cosine = greater(absolute(wi.z), splat(1.0e-7f));
    const vec3 up = vec3_of(wi.x, wi.y, cosine);

    // The density of directions that depend on no facet
    const vfloat multiple = above ? probability->multiple_reflection : probability->multiple_transmission;
    vfloat density = warp_cosine_hemisphere_pdf(cosine) * (above ? probability->diffuse : probability->diffuse_transmission), one;
    if (lane_any(multiple > 0.0f)) density = fma(multiple, warp_low_hemisphere_pdf(cosine, c->low2, c->octaves), density);

    // Metal and glass
    vec3 wm = up, f = vec3_all(0.0f);
    if (lane_any(c->reflection.present | c->glass.present | c->coat.present)) wm = ggx_between(c->least_alpha, wo, up);
    vfloat albedo = splat(0.0f), grazing = splat(0.0f);      // E(μi), and of grazing light (material/albedo.h)
    if (lane_any(c->reflection.present)) {
        albedo = albedo_facets(c->tables, &c->facets, up);
        if (lane_any(c->diffuse.covered)) grazing = albedo_grazing(c->tables, c->facets.base, albedo_seen(&c->facets, up), cosine);
        f = reflection_eval(&c->reflection, c->facets.alpha, wm, wo, up, splat(1.0f) - albedo, &one);
        density = above ? fma(probability->reflection, one, density) : density;
    }
    f = choose(above, f, vec3_all(0.0f));
    if (lane_any(c->glass.present)) {
        f = add(f, glass_eval(&c->glass, &c->facets, c->tables, wm, wo, wi, &one));
        density = fma(probability->glass, one, density);
    }
    if (lane_any(probability->uniform > 0.0f)) density = above ? fma(probability->uniform, splat(SHEEN_PDF), density) : density;

    // Sheen and coat on them, and the diffuse surface below all
    vfloat transmittance = splat(1.0f);
    if (lane_any(c->sheen.present | c->coat.present)) {
        transmittance = closure_transmittance(c, cosine);
        f = closure_eval_layers(c, f, wm, wo, up, above, transmittance, &density);
    }
    if (lane_any(c->diffuse.present)) {
        const vec3 layer = closure_layer_albedo(c, albedo, grazing, up);
        const vec3 diffuse = diffuse_eval(&c->diffuse, c->tables, wo, up, above, layer, c->inside ? splat(1.0f) : transmittance);
        f = choose(above | (c->diffuse.transmission > 0.0f), add(f, diffuse), f);
    }
#ifdef HAIR
    if (lane_any(c->hair.present)) {
        vfloat its;
        f = choose(c->hair.present, hair_eval(&c->hair, wo, vec3_of(wi.x, wi.y, above ? cosine : -cosine), &its), f);
        density = c->hair.present ? its : density;
    }
#endif
#ifdef MEASURED
    if (lane_any(c->measured.present)) {
        vfloat its;
        f = choose(c->measured.present, closure_at_wavelengths(c, measured_eval(&c->measured, up, cosine, &its)), f);
        density = c->measured.present ? its : density;
    }
#endif
#ifdef PLUGIN_BSDFS
    const vmask given = c->plugin != 0u;
    if (lane_any(given)) {
        vfloat its;
        f = choose(given, closure_at_wavelengths(c, plugin_eval(c->plugin, c->numbers, wo, vec3_of(wi.x, wi.y, above ? cosine : -cosine), &its)), f);
        density = given ? its : density;
    }
#endif
    *pdf = density;
    return f;
}

// Whether a way is chosen that has this share of what `u` has not passed yet; then `u` is stretched over the unit interval again.
static vmask closure_chooses(vmask* open, vfloat* u, vfloat share) {
    const vmask taken = *open & (*u < share);
    *u = *open ? (taken ? quotient(*u, share > 0.0f ? share : splat(1.0f)) : *u - share) : *u;
    *open = *open & !taken;
    return taken;
}

// A direction; zero where a facet sends light to a side on which it would have to meet another. `w`: a third random number.
static vec3 closure_sample(const Closure* c, vec3 wo, vfloat u, vfloat v, vfloat w) {
    const LobeProbabilities* probability = &c->probability;
    vmask open = mask_all();
    const vmask reflection = closure_chooses(&open, &u, probability->reflection), coat = closure_chooses(&open, &u, probability->coat);
    const vmask glass = closure_chooses(&open, &u, probability->glass), uniform = closure_chooses(&open, &u, probability->uniform);
    const vmask through = closure_chooses(&open, &u, probability->multiple_transmission);
    const vmask multiple = through | closure_chooses(&open, &u, probability->multiple_reflection);
    const vmask transmission = closure_chooses(&open, &u, probability->diffuse_transmission);
    u = open & (probability->diffuse > 0.0f) ? quotient(u, probability->diffuse > 0.0f ? probability->diffuse : splat(1.0f)) : u;
    u = bounded(u, 0.0f, 0.99999994f);
    vec3 wi = warp_cosine_hemisphere(u, v);
    wi.z = transmission ? -wi.z : wi.z;
    if (lane_any(multiple)) {
        wi = choose(multiple, warp_low_hemisphere(u, v, c->low2, c->octaves), wi);
        wi.z = through ? -wi.z : wi.z;
    }
    if (lane_any(reflection | coat)) {
        Alpha a;
        a.x = coat ? c->coat.alpha : c->facets.alpha.x;
        a.y = coat ? c->coat.alpha : c->facets.alpha.y;
        const vec3 wm = ggx_sample(a, wo, u, v);
        const vec3 mirrored = sub(scale(wm, inner(wo, wm) * 2.0f), wo);
        wi = choose(reflection | coat, choose(mirrored.z > 0.0f, mirrored, vec3_all(0.0f)), wi);
    }
    if (lane_any(glass)) wi = choose(glass, glass_sample(&c->glass, c->facets.alpha, wo, u, v, w), wi);
    if (lane_any(uniform)) {
        const vec3 around = warp_sphere(u * 0.5f, v);
        wi = choose(uniform, vec3_of(around.x, around.y, greater(around.z, splat(1.0e-7f))), wi);
    }
#ifdef HAIR
    // Its way is that of the diffuse lobe, with probability 1, so `u` is still what it was
    if (lane_any(c->hair.present)) wi = choose(c->hair.present, hair_sample(&c->hair, wo, u, v, w), wi);
#endif
#ifdef MEASURED
    if (lane_any(c->measured.present)) wi = choose(c->measured.present, measured_sample(&c->measured, u, v), wi);
#endif
#ifdef PLUGIN_BSDFS
    // Its way is that of the diffuse lobe, with probability 1, so `u` is still what it was
    const vmask given = c->plugin != 0u;
    if (lane_any(given)) wi = choose(given, plugin_sample(c->plugin, c->numbers, wo, u, v, w), wi);
#endif
    return wi;
}

#ifdef INVARIANTS
static vmask closure_violates(const Closure* c, vmask where) {
    const LobeProbabilities* p = &c->probability;
    const vmask first = invariant_positive(p->diffuse) & invariant_positive(p->diffuse_transmission) & invariant_positive(p->uniform) & invariant_positive(p->reflection);
    const vmask second = invariant_positive(p->glass) & invariant_positive(p->multiple_reflection) & invariant_positive(p->multiple_transmission) & invariant_positive(p->coat);
    const vfloat sum = p->diffuse + p->diffuse_transmission + p->uniform + p->reflection + p->glass + p->multiple_reflection + p->multiple_transmission + p->coat;
    const vmask layers = invariant_positive(c->transmittance) & (c->transmittance <= 1.0f) & invariant_positive3(c->albedo) & (largest(c->albedo) <= 1.01f);
    return where & c->present & !(first & second & invariant_near(sum, 1.0f) & layers & (c->facets.alpha.y > 0.0f));
}
#endif

#endif
