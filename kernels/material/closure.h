// What a point scatters light with: a sum of lobes, each at its share of the surface.
//
// The base is metal, or a diffuse surface below a layer that reflects, or glass, or a blend of the three. Sheen lies on it, and a clear
// coat on the sheen. Each of these two takes of the light along a direction what it reflects itself, E(μ); what is below keeps
// min(1 − E(μo), 1 − E(μi)), which is reciprocal and never gains energy (glTF, KHR_materials_sheen). lobe/diffuse.h and lobe/covered.h
// give back what a diffuse surface and metal lose so.
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
#include "material/lobe/reflection.h"
#include "material/lobe/sheen.h"
#include "material/parameters.h"

#define CLOSURE_SMOOTH 1.0e-3f     // alphas below it make a delta: single precision has no digits left for narrower lobes
#define CLOSURE_LEAST_BEND 1.0e-3f // an index closer to 1 bends light by less than single precision resolves
#define SHEEN_LEAST_ALPHA 1.0e-2f
#define CLOSURE_LOW 1.5f           // alphas from the horizon, where rough facets lose most of what they lose at first

typedef struct {
    __global const float* tables;
    vmask there;             // the lobes below are all that the point scatters with; else it is what Bsdf says
    Facets facets;           // of the base
    Diffuse diffuse;
    Reflection reflection;
    Glass glass;
    Sheen sheen;
    Coat coat;
    Covered coated, clothed; // metal below the coat, and below sheen
    vec3 metal;              // what it reflects on average, times its share
    vmask inside;            // seen from within a solid: coat and sheen lie on the other side
    vfloat below;            // what coat and sheen leave of light along `wo`
    vfloat smoothest;        // alpha of the facets
    vec3 albedo;             // about the share of light along `wo` that is reflected or passes
    // How often each way is sampled; sum 1. Back and through: what meets more than one facet; under: diffuse light on the other side
    vfloat with_cosine, with_under, with_back, with_through, with_reflection, with_glass, with_even, with_coat;
    vfloat low2, octaves;    // of warp_low_hemisphere, for what meets more than one facet
} Closure;

// Where light goes to the other side, or comes from there.
static vmask closure_passes(const Closure* c) { return c->there & (c->glass.there | (c->diffuse.there & (c->diffuse.passes > 0.0f))); }

static vfloat closure_mean(vec3 v) { return (v.x + v.y + v.z) * (1.0f / 3.0f); }

// What sheen and coat leave of light along a direction.
static vfloat closure_below(const Closure* c, vfloat cosine) {
    vfloat left = splat(1.0f);
    if (lane_any(c->sheen.there)) {
        const vfloat taken = largest(c->sheen.color) * sheen_albedo(&c->sheen, c->tables, cosine);
        left = c->sheen.there ? splat(1.0f) - taken : left;
    }
    if (lane_any(c->coat.there)) left = left * (splat(1.0f) - coat_albedo(&c->coat, c->tables, cosine));
    return left;
}

// Both as covers of a diffuse surface.
static Covers closure_covers(const Closure* c) {
    const vfloat none = splat(0.0f), one = splat(1.0f);
    Covers over;
    over.sheen_passes = over.coat_passes = one;
    over.sheen.b = over.sheen.c = over.coat.b = over.coat.c = none;
    if (lane_any(c->sheen.there & !c->inside)) {
        const vmask there = c->sheen.there & !c->inside;
        const vfloat most = largest(c->sheen.color), mean = albedo_line(c->tables, splat_uint(ALBEDO_SHEEN_MEAN), SHEEN_ROWS, c->sheen.alpha);
        const vfloat passes = fma(-most, mean, one), share = there ? quotient(most, passes) : none;
        over.sheen_passes = there ? passes * fma(most * c->diffuse.roughness, quotient(splat(DIFFUSE_SHEEN_SLACK), c->sheen.alpha), one) : one;
        const Slant s = albedo_slant(c->tables, 2u, c->sheen.alpha);
        over.sheen.b = s.b * share, over.sheen.c = s.c * share;
    }
    if (lane_any(c->coat.there & !c->inside)) {
        const vmask there = c->coat.there & !c->inside;
        over.coat_passes = there ? one - coat_average(&c->coat, c->tables) : one;
        const vfloat share = there ? quotient(c->coat.share, over.coat_passes) : none;
        const Slant e = albedo_slant(c->tables, 0u, c->coat.alpha), g = albedo_slant(c->tables, 1u, c->coat.alpha);
        over.coat.b = fma(g.b, splat(1.0f - COAT_F0), e.b * COAT_F0) * share;
        over.coat.c = fma(g.c, splat(1.0f - COAT_F0), e.c * COAT_F0) * share;
    }
    return over;
}

// Which lobes there are, and their numbers as far as they do not depend on `wo`. `front`: seen from the front.
static void closure_lobes(const Scene* scene, const Parameters* p, vmask front, Closure* c) {
    c->tables = scene->albedo_tables;
    const vmask layered = p->kind == MATERIAL_PRINCIPLED, metal = p->kind == MATERIAL_CONDUCTOR, schlick = parameters_flag(p, MATERIAL_FLAG_SCHLICK);
    const vfloat alpha = p->roughness * p->roughness, none = splat(0.0f), one = splat(1.0f);
    const vmask glass = p->kind == MATERIAL_DIELECTRIC, thin = parameters_flag(p, MATERIAL_FLAG_THIN);
    const vmask lit = front | !parameters_flag(p, MATERIAL_FLAG_ONE_SIDED), beckmann = parameters_flag(p, MATERIAL_FLAG_BECKMANN);
    c->facets = facets_of(alpha, CLOSURE_SMOOTH, p->anisotropy, beckmann);

    // The shares of metal, glass, and of what is neither, of the base
    const vfloat metallic = layered ? p->metallic : metal ? one : none;
    const vfloat clear = layered ? (one - metallic) * p->transmission : glass ? one : none;
    const vfloat plastic = layered ? greater(one - metallic - clear, none) : none;

    // Reflection: what is neither metal nor glass reflects by Schlick's approximation for its index (glTF, KHR_materials_specular)
    const vfloat ratio = quotient(p->ior - 1.0f, p->ior + 1.0f);
    const vec3 tint = scale(p->specular_color, ratio * ratio);
    const vec3 f0 = scale(vec3_of(lesser(tint.x, one), lesser(tint.y, one), lesser(tint.z, one)), p->specular);
    const vec3 f90 = vec3_of(p->specular, p->specular, p->specular);
    Reflection* r = &c->reflection;
    r->there = lit & ((layered & (clear < 1.0f)) | (metal & (alpha >= CLOSURE_SMOOTH)));
    r->measured = metal & !schlick;
    r->beckmann = beckmann & r->there;
    r->f0 = choose(r->measured, p->eta, along(scale(p->color, metallic), f0, plastic));
    r->f90 = choose(r->measured, p->k, along(vec3_of(metallic, metallic, metallic), f90, plastic));
    r->multiple = r->f0;
    r->missing = none;

    // Diffuse reflection
    Diffuse* d = &c->diffuse;
    d->there = lit & ((p->kind == MATERIAL_OREN_NAYAR) | (plastic > 0.0f));
    d->covered = layered;
    d->color = p->color;
    d->share = layered ? plastic : one;
    d->passes = p->diffuse_transmission;
    d->passes_color = p->diffuse_transmission_color;
    d->roughness = p->diffuse_roughness;
    d->f0 = f0, d->f90 = f90;
    d->passed = vec3_all(1.0f);
    d->bends = mask_none();

    // Glass. Where it bends nothing, its facets would have no direction
    Glass* g = &c->glass;
    g->thin = thin;
    g->beckmann = beckmann & glass;
    g->base = c->facets.base;
    const vfloat ior = thin & (p->ior < 1.0f) ? quotient(one, p->ior) : p->ior, turned = front | thin ? ior : quotient(one, ior);
    const vfloat least = turned < 1.0f ? splat(1.0f - CLOSURE_LEAST_BEND) : splat(1.0f + CLOSURE_LEAST_BEND);
    g->eta = absolute(turned - 1.0f) < CLOSURE_LEAST_BEND ? least : turned;
    g->there = lit & (clear > 0.0f) & (layered | ((alpha >= CLOSURE_SMOOTH) & (thin | (absolute(turned - 1.0f) >= CLOSURE_LEAST_BEND))));
    g->color = p->color;
    g->share = clear;
    g->alpha = c->facets.mean;
    g->missing = g->passes = g->back = g->through = g->squeezed = none;

    // Sheen and coat
    c->inside = (clear > 0.0f) & !thin & !front;
    const vfloat cloth = greater(p->sheen_roughness * p->sheen_roughness, splat(SHEEN_LEAST_ALPHA));
    c->sheen.there = layered & lit & (largest(p->sheen_color) > 0.0f);
    c->sheen.color = p->sheen_color;
    c->sheen.alpha = cloth;
    c->sheen.scale = c->sheen.hidden = none;
    c->coat.there = layered & lit & (p->coat > 0.0f);
    c->coated.there = c->clothed.there = mask_none();
    c->metal = vec3_all(0.0f);
    c->coat.share = p->coat;
    c->coat.alpha = greater(p->coat_roughness * p->coat_roughness, splat(CLOSURE_SMOOTH));
}

// What depends on `wo`, and how often each way to choose a direction is taken: as often as it reflects light, about.
static void closure_prepare(Closure* c, const Parameters* p, vec3 wo) {
    const vfloat none = splat(0.0f);
    const vmask once = parameters_flag(p, MATERIAL_FLAG_SINGLE_SCATTERING);
    c->smoothest = c->coat.there ? lesser(c->facets.alpha.y, c->coat.alpha) : c->facets.alpha.y;
    vec3 reflected = vec3_all(0.0f), again = vec3_all(0.0f), spread = vec3_all(0.0f), under = vec3_all(0.0f), passed = vec3_all(0.0f);
    c->with_through = none;
    c->below = c->inside ? splat(1.0f) : closure_below(c, wo.z);
    vfloat glassy = none, glass_spread = none;
    if (lane_any(c->reflection.there)) {
        const vfloat all = albedo_facets(c->tables, &c->facets, wo), grazing = albedo_grazing(c->tables, albedo_seen(&c->facets, wo), wo.z);
        const vfloat lost = albedo_facets_lost(c->tables, &c->facets);
        const vec3 average = choose(c->reflection.measured, p->fresnel, fresnel_schlick_average(p->color, vec3_all(1.0f)));
        const vfloat metallic = p->kind == MATERIAL_CONDUCTOR ? splat(1.0f) : p->metallic;
        const vmask below_coat = c->coat.there & (metallic > 0.0f), below_sheen = c->sheen.there & (metallic > 0.0f);
        if (lane_any(below_coat | below_sheen)) {
            c->metal = scale(average, metallic);
            c->coated = covered_by(c->tables, COVERED_BY_COAT, below_coat, c->coat.share, c->coat.alpha, c->facets.mean, wo.z);
            c->clothed = covered_by(c->tables, COVERED_BY_SHEEN, below_sheen, largest(c->sheen.color), c->sheen.alpha, c->facets.mean, wo.z);
        }
        c->reflection.missing = once ? none : splat(1.0f) - all;
        c->reflection.multiple = scale(reflection_multiple(average, lost), metallic);
        const vec3 f0 = choose(c->reflection.measured, p->color, c->reflection.f0), f90 = choose(c->reflection.measured, vec3_all(1.0f), c->reflection.f90);
        reflected = choose(c->reflection.there, along(scale(f0, all), sub(f90, f0), all * grazing), reflected);
        again = choose(c->reflection.there, scale(c->reflection.multiple, c->reflection.missing * lost * PI), again);
        if (lane_any(c->diffuse.there & c->diffuse.covered)) {
            const Covers over = closure_covers(c);
            diffuse_cover(&c->diffuse, &over, c->tables, c->facets.mean, splat(1.0f) - lost, all, grazing, c->below, wo.z);
            const vec3 left = choose(c->diffuse.covered, sub(vec3_all(1.0f), diffuse_layer(&c->diffuse, all, grazing)), vec3_all(1.0f));
            spread = choose(c->diffuse.there, scale(mul(c->diffuse.color, left), diffuse_share(&c->diffuse, mask_all())), spread);
            under = choose(c->diffuse.there, scale(mul(c->diffuse.passes_color, left), diffuse_share(&c->diffuse, mask_none())), under);
        }
    }
    spread = choose(c->diffuse.there & !c->diffuse.covered, c->diffuse.color, spread);
    if (lane_any(c->glass.there)) {
        glass_prepare(&c->glass, &c->facets, c->tables, wo);
        c->glass.missing = once ? none : c->glass.missing;
        const vfloat share = c->glass.there ? c->glass.share : none, back = glass_fresnel(&c->glass, wo.z);
        glassy = share * (splat(1.0f) - c->glass.missing);
        glass_spread = share * c->glass.missing * (splat(1.0f) - c->glass.passes);
        c->with_through = share * c->glass.missing * c->glass.passes;
        passed = scale(add(vec3_of(back, back, back), scale(c->glass.color, splat(1.0f) - back)), share);
    }
    passed = add(passed, under);
    vfloat coat = none, sheen = none;
    if (lane_any(c->coat.there)) coat = c->inside ? none : coat_albedo(&c->coat, c->tables, wo.z);
    if (lane_any(c->sheen.there)) {
        c->sheen.scale = albedo_line(c->tables, splat_uint(ALBEDO_SHEEN_SCALE), SHEEN_ROWS, c->sheen.alpha);
        c->sheen.hidden = sheen_hidden(&c->sheen, wo.z);
        sheen = c->sheen.there & !c->inside ? sheen_albedo(&c->sheen, c->tables, wo.z) * (splat(1.0f) - coat) : none;
    }
    c->albedo = add(add(vec3_of(coat, coat, coat), scale(c->sheen.color, sheen)), scale(add(add(reflected, add(again, spread)), passed), c->below));
    c->albedo = choose(c->there, c->albedo, vec3_all(0.0f));

    // In shares of the sum. What reflects nothing is sampled by the cosine
    c->with_coat = coat;
    // Rough diffuse surfaces seen at grazing angles scatter over their cosine towards the horizon (EON)
    const vfloat even = c->diffuse.there ? c->diffuse.roughness * 0.5f * fresnel_grazing(wo.z) : none;
    const vfloat diffuse = closure_mean(spread) * c->below;
    c->with_even = fma(diffuse, even, largest(c->sheen.color) * sheen);
    c->with_reflection = closure_mean(reflected) * c->below;
    c->with_glass = glassy * c->below;
    c->with_through = c->with_through * c->below;
    c->with_back = (closure_mean(again) + glass_spread) * c->below;
    c->with_cosine = diffuse * (splat(1.0f) - even);
    c->with_under = closure_mean(under) * c->below;
    const vfloat sum = c->with_coat + c->with_even + c->with_reflection + c->with_glass + c->with_through + c->with_back + c->with_cosine + c->with_under;
    const vfloat inverse = inverse_or_one(sum);
    c->with_coat = c->with_coat * inverse, c->with_even = c->with_even * inverse, c->with_reflection = c->with_reflection * inverse;
    c->with_glass = c->with_glass * inverse, c->with_through = c->with_through * inverse, c->with_back = c->with_back * inverse;
    c->with_under = c->with_under * inverse;
    c->low2 = c->octaves = splat(1.0f);
    if (lane_any((c->with_back > 0.0f) | (c->with_through > 0.0f))) {
        // Within glass of an index near 1 most light is lost near the horizon; metals lose it more evenly
        const vfloat eta = c->glass.eta, bends = c->glass.there & !c->glass.thin ? absolute(quotient(eta - 1.0f, eta + 1.0f)) : splat(1.0f);
        const vfloat low = c->facets.mean * fma(bends * c->facets.mean, splat(12.0f), splat(CLOSURE_LOW));
        c->low2 = low * low;
        c->octaves = log2_of(splat(1.0f) + quotient(splat(1.0f), c->low2));
    }
    c->with_cosine = sum > 0.0f ? c->with_cosine * inverse : splat(1.0f);
}

// What sheen leaves along both directions.
static vfloat closure_unclothed(const Closure* c, vfloat out, vfloat in) {
    if (!lane_any(c->sheen.there)) return splat(1.0f);
    const vfloat most = largest(c->sheen.color), taken = greater(sheen_albedo(&c->sheen, c->tables, out), sheen_albedo(&c->sheen, c->tables, in));
    return c->sheen.there ? fma(-most, taken, splat(1.0f)) : splat(1.0f);
}

// f, and the density.
static vec3 closure_eval(const Closure* c, vec3 wo, vec3 wi, vfloat* pdf) {
    const vmask above = wi.z > 0.0f;
    const vfloat cosine = greater(absolute(wi.z), splat(1.0e-7f));
    const vec3 up = vec3_of(wi.x, wi.y, cosine);
    const vfloat again = above ? c->with_back : c->with_through;
    vec3 f = vec3_all(0.0f);
    vfloat density = warp_cosine_hemisphere_pdf(cosine) * (above ? c->with_cosine : c->with_under), one;
    if (lane_any(again > 0.0f)) density = fma(again, warp_low_hemisphere_pdf(cosine, c->low2, c->octaves), density);

    vec3 m = up;
    if (lane_any(c->reflection.there | c->glass.there | c->coat.there)) m = ggx_between(c->smoothest, wo, up);

    // The base
    vfloat all = splat(0.0f), grazing = splat(0.0f);
    if (lane_any(c->reflection.there)) {
        all = albedo_facets(c->tables, &c->facets, up);
        if (lane_any(c->diffuse.covered)) grazing = albedo_grazing(c->tables, albedo_seen(&c->facets, up), cosine);
        f = reflection_eval(&c->reflection, c->facets.alpha, m, wo, up, splat(1.0f) - all, &one);
        density = above ? fma(c->with_reflection, one, density) : density;
    }
    f = choose(above, f, vec3_all(0.0f));
    if (lane_any(c->glass.there)) {
        f = add(f, glass_eval(&c->glass, &c->facets, c->tables, m, wo, wi, &one));
        density = fma(c->with_glass, one, density);
    }

    if (lane_any(c->with_even > 0.0f)) density = above ? fma(c->with_even, splat(SHEEN_PDF), density) : density;

    // Sheen and coat on it
    vfloat other = splat(1.0f);
    if (lane_any(c->sheen.there | c->coat.there)) {
        other = closure_below(c, cosine);
        const vmask passes = !above & !c->glass.thin;
        const vfloat within = above ? splat(1.0f) : other;
        f = scale(f, c->inside ? within : passes ? c->below : lesser(c->below, other));
        if (lane_any(c->sheen.there)) {
            const vfloat coat = lesser(splat(1.0f) - coat_albedo(&c->coat, c->tables, wo.z), splat(1.0f) - coat_albedo(&c->coat, c->tables, cosine));
            if (lane_any(c->clothed.there)) f = along(f, c->metal, above & !c->inside ? coat * covered_eval(&c->clothed, c->tables, cosine) : splat(0.0f));
            f = choose(above & !c->inside, add(f, scale(sheen_eval(&c->sheen, wo, up), coat)), f);
        }
        if (lane_any(c->coat.there)) {
            const vfloat shine = coat_eval(&c->coat, m, wo, up, &one);
            if (lane_any(c->coated.there)) f = along(f, c->metal, above & !c->inside ? closure_unclothed(c, wo.z, cosine) * covered_eval(&c->coated, c->tables, cosine) : splat(0.0f));
            f = choose(above & !c->inside, add(f, vec3_of(shine, shine, shine)), f);
            density = above ? fma(c->with_coat, one, density) : density;
        }
    }
    if (lane_any(c->diffuse.there)) {
        const vec3 spread = diffuse_eval(&c->diffuse, c->tables, wo, up, above, all, grazing, c->inside ? splat(1.0f) : other);
        f = choose(above | (c->diffuse.passes > 0.0f), add(f, spread), f);
    }
    *pdf = density;
    return f;
}

// Whether a way is taken that has this share of what `u` has not passed yet; then `u` is stretched over the unit interval again.
static vmask closure_takes(vmask* open, vfloat* u, vfloat share) {
    const vmask taken = *open & (*u < share);
    *u = *open ? (taken ? quotient(*u, share > 0.0f ? share : splat(1.0f)) : *u - share) : *u;
    *open = *open & !taken;
    return taken;
}

static void closure_at(const Scene* scene, const Parameters* p, vec3 wo, vmask front, Closure* c) {
    closure_lobes(scene, p, front, c);
    c->there = c->reflection.there | c->diffuse.there | c->glass.there | c->sheen.there | c->coat.there;
    closure_prepare(c, p, wo);
}

// A direction; zero where a facet sends light to a side on which it would have to meet another. `w`: a third random number.
static vec3 closure_sample(const Closure* c, vec3 wo, vfloat u, vfloat v, vfloat w) {
    vmask open = mask_all();
    const vmask reflection = closure_takes(&open, &u, c->with_reflection), coat = closure_takes(&open, &u, c->with_coat);
    const vmask glass = closure_takes(&open, &u, c->with_glass), even = closure_takes(&open, &u, c->with_even);
    const vmask through = closure_takes(&open, &u, c->with_through), back = closure_takes(&open, &u, c->with_back);
    const vmask under = closure_takes(&open, &u, c->with_under);
    u = open & (c->with_cosine > 0.0f) ? quotient(u, c->with_cosine > 0.0f ? c->with_cosine : splat(1.0f)) : u;
    u = bounded(u, 0.0f, 0.99999994f);
    vec3 wi = warp_cosine_hemisphere(u, v);
    wi.z = under ? -wi.z : wi.z;
    if (lane_any(back | through)) {
        wi = choose(back | through, warp_low_hemisphere(u, v, c->low2, c->octaves), wi);
        wi.z = through ? -wi.z : wi.z;
    }
    if (lane_any(reflection | coat)) {
        Alpha a;
        a.x = coat ? c->coat.alpha : c->facets.alpha.x;
        a.y = coat ? c->coat.alpha : c->facets.alpha.y;
        const vec3 m = ggx_sample(a, wo, u, v);
        const vec3 mirrored = sub(scale(m, inner(wo, m) * 2.0f), wo);
        wi = choose(reflection | coat, choose(mirrored.z > 0.0f, mirrored, vec3_all(0.0f)), wi);
    }
    if (lane_any(glass)) wi = choose(glass, glass_sample(&c->glass, c->facets.alpha, wo, u, v, w), wi);
    if (lane_any(even)) {
        const vec3 around = warp_sphere(u * 0.5f, v);
        wi = choose(even, vec3_of(around.x, around.y, greater(around.z, splat(1.0e-7f))), wi);
    }
    return wi;
}

#endif
