// Every scatterer behind one triple: bsdf_at, bsdf_eval, bsdf_sample. World space; directions point away from the surface.
//
// Materials that have rows of parameters, and all lobes that they are made of, are built only where a scene has them (-D MATERIALS): a
// scene without pays nothing for them. What a program without SUBSURFACE or MEDIA lacks is nowhere by bsdf_passes and bsdf_in_medium, so
// that compilers leave it out.
#ifndef MATERIAL_BSDF_H
#define MATERIAL_BSDF_H

#include "core/bent.h"
#include "core/frame.h"
#include "core/sampler.h"
#include "geometry/surface.h"
#include "material/dielectric.h"
#include "material/lambert.h"
#include "material/mirror.h"
#ifdef MATERIALS
#include "material/layering.h"
#endif
#include "medium/phase.h"
#include "spectral/color.h"
#ifdef TEXTURES
#include "texture/normal_map.h"
#include "texture/parameter.h"
#endif

// Rough glass that disperses light scatters each wavelength otherwise. A direction is sampled for one of a path's, and weighed with the density of
// all three (West, Georgiev, Gruson and Hachisuka, "Continuous multiple importance sampling", ACM TOG 39(4), 2020, section 6.2).
#if defined(SPECTRAL) && defined(DISPERSION) && defined(MATERIALS) && !defined(WAVELENGTHS_EQUAL)
#define BSDF_APART
#endif

typedef struct BsdfStruct {
    Frame frame;         // around the shading normal, on the side of wo
    vec3 wo;             // local, towards where the light is seen from, a unit vector with z above 0
    vec3 side;           // geometric normal on the side of wo
    vec3 color;
    vfloat eta;          // index beyond over index on wo's side
    vuint kind;
    vmask specular;      // all of it is a delta: only sampling it finds where light comes from
#ifdef DISPERSION
    vmask disperses;     // it sends each wavelength another way
#endif
#ifdef BSDF_APART
    vmask apart;         // it is another one at each wavelength,
    const struct BsdfStruct* each;       // these three,
    vec3 shares;         // and is sampled so often as each of them
#endif
#ifdef MATERIALS
    Closure closure;
    vmask thin;          // a smooth wall without thickness, whose own index is closure.glass.eta
#ifdef SPECULAR_CHAINS
    vmask mixed;         // of mixed materials
#endif
#endif
#ifdef SUBSURFACE
    vmask passes;        // the surface of a subsurface material: all light that can goes through, and is spread by the cosine
#endif
#ifdef MEDIA
    vmask medium;        // no surface: a medium, which scatters to all sides by its phase function; z points back
    vfloat g;            // its mean cosine
#endif
} Bsdf;

typedef struct {
    vec3 direction;      // unit, world
    vec3 weight;         // f |cosθ| / pdf; zero ends the path
    vfloat pdf;          // per steradian; 0 where the BSDF is specular (but whether it is, the mask says)
} BsdfSample;

static vmask bsdf_passes(const Bsdf* b) {
#ifdef SUBSURFACE
    return b->passes;
#else
    return mask_none();
#endif
}
static vmask bsdf_in_medium(const Bsdf* b) {
#ifdef MEDIA
    return b->medium;
#else
    return mask_none();
#endif
}
static vfloat bsdf_mean_cosine(const Bsdf* b) {
#ifdef MEDIA
    return b->g;
#else
    return splat(0.0f);
#endif
}

// The shading normal on the side of the viewer. That of what is glossy and opaque is bent if it is interpolated; a normal map's already is.
static vec3 bsdf_normal(const Surface* s, vec3 shading, vec3 side, vec3 direction, vmask glossy) {
    if (!lane_any(glossy)) return shading;
    const vec3 smooth = choose(s->front, s->shading, negate(s->shading));
    const vmask own = (shading.x == smooth.x) & (shading.y == smooth.y) & (shading.z == smooth.z);
    const vmask flat = (shading.x == side.x) & (shading.y == side.y) & (shading.z == side.z);
    const vmask bends = glossy & own & !flat & bent_needed(shading, side, negate(direction));
    return lane_any(bends) ? choose(bends, bent_normal(shading, side, negate(direction)), shading) : shading;
}

// Towards the viewer, a unit vector. An interpolated normal may look away from there: then it is seen at the most grazing angle.
static vec3 bsdf_wo(Frame frame, vec3 direction) {
    const vec3 wo = frame_to_local(frame, negate(direction));
    const vfloat least = splat(1.0e-7f);
    const vmask away = wo.z < least;
    if (!lane_any(away)) return wo;
    const vec3 level = unit(vec3_of(wo.x, wo.y, splat(0.0f)));
    const vmask opposite = (level.x == 0.0f) & (level.y == 0.0f);
    return choose(away, vec3_of(opposite ? splat(1.0f) : level.x, level.y, least), wo);
}

#ifdef MATERIALS
// The same frame with its x axis where a surface is roughest, `turn` from the tangent of its vertices, or else from the one that goes
// round the y axis.
static Frame bsdf_turned_frame(const Scene* scene, const Surface* surface, vec3 n, vmask asked, vfloat turn) {
    // About the axis itself, round the x axis
    const vmask pole = fma(n.x, n.x, n.z * n.z) < 1.0e-6f;
    vec3 around = choose(pole, vec3_of(splat(0.0f), n.z, -n.y), vec3_of(n.z, splat(0.0f), -n.x));
#ifdef TANGENTS
    vec3 given = around;
    vfloat sign = splat(1.0f);
    const vmask has = normal_map_tangent(scene, &surface->attributes, asked, &given, &sign);
    const vec3 level = sub(given, scale(n, inner(given, n)));
    const vmask sound = has & (inner(level, level) > 1.0e-12f);
    around = choose(sound, level, around);
    // Counter-clockwise as seen from the front, and where pictures are mirrored the other way round
    turn = sound & ((sign < 0.0f) != !surface->front) ? -turn : turn;
#endif
    const vec3 tangent = unit(around), bitangent = outer(n, tangent);
    vfloat c, s;
    cos_sin_turn(turn, &c, &s);
    Frame f;
    f.tangent = along(scale(tangent, c), bitangent, s);
    f.bitangent = along(scale(bitangent, c), tangent, -s);
    f.normal = n;
    return f;
}

// What materials with rows are, instead.
static void bsdf_read_rows(const Scene* scene, const Surface* s, vec3 direction, const Parameters* p, Bsdf* b) {
    const vmask anisotropic = p->anisotropy > 0.0f;
    if (lane_any(anisotropic)) {
        const Frame turned = bsdf_turned_frame(scene, s, b->frame.normal, anisotropic, p->rotation);
        b->frame.tangent = choose(anisotropic, turned.tangent, b->frame.tangent);
        b->frame.bitangent = choose(anisotropic, turned.bitangent, b->frame.bitangent);
        b->wo = choose(anisotropic, bsdf_wo(b->frame, direction), b->wo);
    }
#if defined(HAIR) && defined(CURVES)
    // Along the curve
    const vmask fibre = (p->kind == MATERIAL_HAIR) & s->curve;
    if (lane_any(fibre)) {
        b->frame.tangent = choose(fibre, s->tangent, b->frame.tangent);
        b->frame.bitangent = choose(fibre, outer(b->frame.normal, s->tangent), b->frame.bitangent);
        b->wo = choose(fibre, bsdf_wo(b->frame, direction), b->wo);
    }
#endif
    const vmask by_row = s->kind == MATERIAL_BY_ROW, black = parameters_flag(p, MATERIAL_FLAG_ONE_SIDED) & !s->front;
    closure_at(scene, p, b->wo, s->front, &b->closure);
    b->color = choose(black, vec3_all(0.0f), p->color);
    b->kind = black ? splat_uint(MATERIAL_LAMBERT) : p->kind;
#ifdef DISPERSION
    b->disperses = p->disperses;
#endif
    b->thin = by_row & parameters_flag(p, MATERIAL_FLAG_THIN);
    b->eta = b->thin ? splat(1.0f) : s->front ? p->ior : quotient(splat(1.0f), p->ior);
#ifdef SPECULAR_CHAINS
    b->mixed = p->mixed;
#endif
    const vmask delta = (b->kind == MATERIAL_MIRROR) | (b->kind == MATERIAL_DIELECTRIC) | (b->kind == MATERIAL_CONDUCTOR);
    b->specular = delta & !b->closure.present;
}

static void bsdf_no_rows(Bsdf* b) {
#ifdef SPECULAR_CHAINS
    b->mixed = mask_none();
#endif
#ifdef HAIR
    b->closure.hair.present = mask_none();
#endif
#ifdef MEASURED
    b->closure.measured.present = mask_none();
#endif
    b->closure.present = b->closure.glass.present = b->closure.glass.thin = b->closure.diffuse.present = b->thin = mask_none();
    b->closure.diffuse.transmission = splat(0.0f);
    b->closure.glass.eta = splat(1.0f);
    b->closure.albedo = vec3_all(0.0f);
#ifdef IRIDESCENCE
    b->closure.glass.film.present = b->closure.reflection.film.present = mask_none();
#endif
#ifdef PLUGIN_BSDFS
    b->closure.plugin = splat_uint(0u);
#endif
}
#endif

// Writes in place: the struct takes kilobytes, and copying it a tenth of the time.
static void bsdf_at(const Scene* scene, const Surface* s, vec3 direction, Bsdf* b) {
    b->side = choose(s->front, s->normal, negate(s->normal));
    vec3 shading = s->shading, color = s->color;
#if defined(TEXTURES) && !defined(MATERIALS)
    vec3 shade = vec3_all(1.0f);
#endif
#ifdef MATERIALS
    vmask described = s->kind == MATERIAL_BY_ROW;
#ifdef TEXTURES
    described = described | s->attributes.textured;
#endif
    const int any_described = lane_any(described);
#if LANES == 1
    Parameters p = {0};  // else those of the last surface would seem to be needed again, and keep their registers
#else
    Parameters p;
#endif
    if (any_described) {
        p = material_at(scene, s, direction);
#ifdef TEXTURES
        shading = p.shading;
#endif
    }
#elif defined(TEXTURES)
    if (lane_any(s->attributes.textured)) {
        const TextureSlots slots = parameter_slots(scene, &s->attributes, vfloat_bits(s->attributes.row[ATTRIBUTE_ROW_SLOTS]));
        color = parameter_base_color(scene, &s->attributes, &slots, color, &shade);
        shading = normal_map_shading(scene, &s->attributes, &slots, s->normal, shading, s->front, direction);
    }
#endif
#ifdef SUBSURFACE
    b->passes = s->kind == MATERIAL_SUBSURFACE;
#endif
#ifdef MEDIA
    b->medium = s->kind == MATERIAL_MEDIUM;
    b->g = s->g;
#endif
    // What enters is never seen to: by the geometry's normal none of it gets lost
    shading = choose(bsdf_passes(b) & s->front, s->normal, shading);
#ifdef MATERIALS
    const vmask glossy = any_described ? parameters_glossy(&p) : s->kind == MATERIAL_MIRROR;
#else
    const vmask glossy = s->kind == MATERIAL_MIRROR;
#endif
    b->frame = frame_around(bsdf_normal(s, choose(s->front, shading, negate(shading)), b->side, direction, glossy));
    b->wo = bsdf_wo(b->frame, direction);
    b->color = color_reflectance(scene, choose(s->kind == MATERIAL_BY_ROW, vec3_all(0.0f), color));
#if defined(SPECTRAL) && defined(TEXTURES) && !defined(MATERIALS)
    b->color = mul(b->color, color_reflectance(scene, shade));
#endif
    b->eta = s->front ? s->ior : quotient(splat(1.0f), s->ior);
    b->kind = s->kind;
#ifdef DISPERSION
    b->disperses = s->disperses;
#endif
#ifdef BSDF_APART
    b->apart = mask_none();
#endif
    b->specular = (s->kind != MATERIAL_LAMBERT) & !bsdf_passes(b) & !bsdf_in_medium(b);
#ifdef MATERIALS
    if (any_described)
        bsdf_read_rows(scene, s, direction, &p, b);
    else
        bsdf_no_rows(b);
#endif
    // A material without an index of its own has MATCHED_IOR
    b->eta = bsdf_passes(b) & (absolute(b->eta - 1.0f) < 4.0f * EPSILON) ? splat(1.0f) : b->eta;
}

// Where light is scattered that arrives on either side.
static vmask bsdf_is_clear(const Bsdf* b) {
    const vmask clear = (b->kind == MATERIAL_DIELECTRIC) | bsdf_in_medium(b);
#ifdef MATERIALS
    return clear | closure_passes(&b->closure);
#else
    return clear;
#endif
}

// What makes flux of radiance that comes along `wi` (world): the square of the index there over that on wo's side.
static vfloat bsdf_index_squared(const Bsdf* b, vec3 wi) {
    const vmask through = inner(wi, b->side) < 0.0f;
    vmask bends = (b->kind == MATERIAL_DIELECTRIC) | bsdf_passes(b);
    vfloat eta = b->eta;
#ifdef MATERIALS
    const Glass* glass = &b->closure.glass;
    const vmask lobes = b->closure.present & glass->present;
    bends = bends | lobes;
    eta = lobes ? (glass->thin ? splat(1.0f) : glass->eta) : eta;
#endif
    return through & bends ? index_flux(eta) : splat(1.0f);
}

// An interpolated normal may have `wi` on another side than the geometry, where there is another index. What lobes reflect and refract is
// then as the shading normal says, and where it goes as the geometry does: in glass no light gets lost. So its radiance is scaled
// by the indices of where it goes.
static vfloat bsdf_other_side(const Bsdf* b, vmask above, vmask above_shading) {
    const vfloat index_squared = bsdf_index_squared(b, negate(b->side));
    const vfloat inverse = quotient(splat(1.0f), index_squared);
    return above == above_shading ? splat(1.0f) : above ? index_squared : inverse;
}

// Where light is also reflected by the surface of a subsurface material: what arrives in a denser medium than is behind it, and cannot pass.
static vmask bsdf_keeps(const Bsdf* b) {
    return bsdf_passes(b) & (b->eta < 1.0f);
}

// At the surface of a subsurface material, whose two sides scatter as a Lambertian one each: the side that light comes from, to be taken for
// that of `wo`. The others stay as they are.
static vec3 bsdf_turn(const Bsdf* b, vec3 v, vmask through) {
    return choose(bsdf_passes(b) & through, negate(v), v);
}
static vec3 bsdf_turn_local(const Bsdf* b, vec3 wi, vmask through) {
    return vec3_of(wi.x, wi.y, bsdf_passes(b) & through ? -wi.z : wi.z);
}

// What the radiance from either side counts there, and how often it is sampled; elsewhere 1.
static vfloat bsdf_share(const Bsdf* b, vmask through, vfloat* sampled) {
    const vmask passes = bsdf_passes(b);
    const vfloat passing = index_passes(b->eta), chosen = through ? passing : splat(1.0f) - passing;
    *sampled = passes ? chosen : splat(1.0f);
    return passes ? (through ? chosen * index_radiance(b->eta) : chosen) : splat(1.0f);
}

// The normal of the side that light has to arrive on to be scattered; zero: on either.
static vec3 bsdf_receives(const Bsdf* b) {
    return choose(bsdf_is_clear(b) | bsdf_keeps(b), vec3_all(0.0f), bsdf_turn(b, b->side, mask_all()));
}

// About the share of light along `wo` that is scattered, by colour; glass that is smooth passes all.
static vec3 bsdf_albedo(const Bsdf* b) {
#ifdef MATERIALS
    return choose(b->closure.present, b->closure.albedo, b->color);
#else
    return b->color;
#endif
}

// f in 1/sr times |cosθ| of a local direction, and the density with which bsdf_sample chooses it. Deltas do not count.
static vec3 bsdf_eval_local(const Bsdf* b, vec3 wi, vfloat* pdf) {
    const vec3 f = lambert_eval(b->color, wi);
    *pdf = lambert_pdf(wi);
#ifdef MATERIALS
    const vmask lobes = b->closure.present;
    if (lane_any(lobes)) {
        vfloat density;
        const vec3 sum = choose(lobes, closure_eval(&b->closure, b->wo, wi, &density), f);
        *pdf = lobes ? density : *pdf;
        return scale(sum, lobes ? absolute(wi.z) : greater(wi.z, splat(0.0f)));
    }
#endif
    return scale(f, greater(wi.z, splat(0.0f)));
}

// The same of a direction in the world.
static vec3 bsdf_eval_one(const Bsdf* b, vec3 direction, vfloat* pdf) {
    vfloat density, sampled;
    const vmask through = inner(direction, b->side) < 0.0f;
    const vec3 wi = bsdf_turn_local(b, frame_to_local(b->frame, direction), through);
    vec3 f = bsdf_eval_local(b, wi, &density);
    const vmask above = inner(direction, bsdf_turn(b, b->side, through)) > 0.0f;
    const vfloat share = bsdf_share(b, through, &sampled);
    f = scale(f, share);
    density = density * sampled;
#ifdef MATERIALS
    const vmask passes = closure_passes(&b->closure);
    if (lane_any(passes)) f = choose(passes, scale(f, bsdf_other_side(b, above, wi.z > 0.0f)), f);
    const vmask scatters = !b->specular & ((above & (wi.z > 0.0f)) | passes);
#else
    const vmask scatters = !b->specular & above;
#endif
    const vmask medium = bsdf_in_medium(b), seen = scatters | medium;
    const vfloat phase = phase_eval(bsdf_mean_cosine(b), -wi.z);
    f = choose(medium, vec3_of(phase, phase, phase), f);
    density = medium ? phase : density;
    *pdf = seen ? density : splat(0.0f);
    return choose(seen, f, vec3_all(0.0f));
}

#ifdef BSDF_APART
__attribute__((noinline)) static vec3 bsdf_eval_each(const Bsdf* b, vec3 direction, vfloat* pdf) {
    vec3 f[3];
    vfloat density[3];
    for (int k = 0; k < 3; ++k) f[k] = bsdf_eval_one(&b->each[k], direction, &density[k]);
    *pdf = fma(b->shares.x, density[0], fma(b->shares.y, density[1], b->shares.z * density[2]));
    return vec3_of(f[0].x, f[1].y, f[2].z);
}
#endif

static vec3 bsdf_eval(const Bsdf* b, vec3 direction, vfloat* pdf) {
#ifdef BSDF_APART
    vfloat density;
    vec3 f = bsdf_eval_one(b, direction, &density);
    if (lane_any(b->apart)) {
        vfloat mixed;
        f = choose(b->apart, bsdf_eval_each(b, direction, &mixed), f);
        density = b->apart ? mixed : density;
    }
    *pdf = density;
    return f;
#else
    return bsdf_eval_one(b, direction, pdf);
#endif
}

#if defined(MATERIALS) && defined(IRIDESCENCE)
// What glass that is smooth passes of each colour below a film.
static vec3 bsdf_film_passes(const Bsdf* b) {
    vfloat beyond;
    const vfloat eta = b->thin ? b->closure.glass.eta : b->eta;
    dielectric_fresnel(b->wo.z, eta, &beyond);
    return glass_film_passes(&b->closure.glass, eta, b->wo.z, beyond);
}
#endif

// Of glass that is smooth, how often it reflects.
static vfloat bsdf_reflects(const Bsdf* b) {
    vfloat beyond, share = dielectric_fresnel(b->wo.z, b->eta, &beyond);
#ifdef MATERIALS
    if (lane_any(b->thin)) share = b->thin ? glass_fresnel(&b->closure.glass, b->wo.z, &beyond) : share;
#ifdef IRIDESCENCE
    const vmask filmed = b->closure.glass.film.present;
    if (lane_any(filmed)) {
        share = filmed ? splat(1.0f) - glass_mean(bsdf_film_passes(b)) : share;
    }
#endif
#endif
    return share;
}

// A local direction of a delta, and its weight.
static vec3 bsdf_sample_delta(const Bsdf* b, vfloat u, vec3* wi) {
    vec3 mirrored, through;
    const vec3 mirror_weight = mirror_sample(b->color, b->wo, &mirrored);
    const vec3 glass_weight = dielectric_sample(b->color, b->eta, b->wo, u, &through);
    const vmask glass = b->kind == MATERIAL_DIELECTRIC;
    *wi = choose(glass, through, mirrored);
    vec3 weight = choose(glass, glass_weight, mirror_weight);
#ifdef MATERIALS
    const vmask metal = b->kind == MATERIAL_CONDUCTOR;
    if (lane_any(metal)) weight = choose(metal, reflection_fresnel(&b->closure.reflection, b->wo.z), weight);
    if (lane_any(glass & b->thin)) {
        vfloat beyond;
        const vmask reflect = u < glass_fresnel(&b->closure.glass, b->wo.z, &beyond), wall = glass & b->thin;
        *wi = choose(wall, choose(reflect, mirrored, negate(b->wo)), *wi);
        weight = choose(wall, choose(reflect, vec3_all(1.0f), b->color), weight);
    }
#ifdef IRIDESCENCE
    const vmask filmed = glass & b->closure.glass.film.present;
    if (lane_any(filmed)) {
        const vfloat chosen = bsdf_reflects(b), left = splat(1.0f) - chosen;
        const vmask reflect = u < chosen;
        const vec3 one = vec3_all(1.0f), passes = bsdf_film_passes(b), colors = sub(one, passes), passed = mul(b->color, passes);
        vec3 refracted;
        dielectric_sample(one, b->eta, b->wo, splat(1.0f), &refracted);
        *wi = choose(filmed, choose(reflect, mirrored, choose(b->thin, negate(b->wo), refracted)), *wi);
        const vfloat over = inverse_or_one(left) * (b->thin ? splat(1.0f) : index_radiance(b->eta));
        weight = choose(filmed, choose(reflect, scale(colors, inverse_or_one(chosen)), scale(passed, over)), weight);
    }
#endif
#endif
    return weight;
}

// Whether light from the other side is sampled at the surface of a subsurface material; `u` is used for that, where there is a choice.
static vmask bsdf_choose_side(const Bsdf* b, vfloat* u) {
    const vmask keeps = bsdf_keeps(b);
    if (!lane_any(keeps)) return mask_all();
    const vfloat passing = index_passes(b->eta);
    const vmask through = !keeps | (*u < passing);
    const vfloat rest = through ? *u * inverse_or_one(passing) : (*u - passing) * inverse_or_one(splat(1.0f) - passing);
    *u = keeps ? lesser(rest, splat(1.0f - EPSILON)) : *u;
    return through;
}

static BsdfSample bsdf_sample_one(const Bsdf* b, vuint bits_u, vuint bits_v) {
    vfloat u = unit_interval(bits_u), sampled;
    const vfloat v = unit_interval(bits_v);
    const vmask through = bsdf_choose_side(b, &u);
    BsdfSample s;
    vec3 wi;
    s.weight = lambert_sample(b->color, u, v, &wi);
    s.pdf = lambert_pdf(wi);
#ifdef MATERIALS
    const vmask lobes = b->closure.present;
    if (lane_any(lobes)) {
        const vec3 sampled = closure_sample(&b->closure, b->wo, u, v, unit_interval(hash_pair(bits_u, bits_v)));
        const vmask lost = (sampled.x == 0.0f) & (sampled.y == 0.0f) & (sampled.z == 0.0f);
        wi = choose(lobes & !lost, sampled, wi);
        vfloat pdf;
        const vec3 f = bsdf_eval_local(b, wi, &pdf);
        s.weight = choose(lobes, choose(lost | !(pdf > 0.0f), vec3_all(0.0f), scale(f, inverse_or_one(pdf))), s.weight);
        s.pdf = lobes ? pdf : s.pdf;
    }
#endif
    if (lane_any(b->specular)) {
        vec3 delta;
        s.weight = choose(b->specular, bsdf_sample_delta(b, u, &delta), s.weight);
        wi = choose(b->specular, delta, wi);
        s.pdf = b->specular ? splat(0.0f) : s.pdf;
    }
    const vmask medium = bsdf_in_medium(b);
    if (lane_any(medium)) {
        const vfloat g = bsdf_mean_cosine(b);
        const vec3 turned = phase_sample(g, u, v);
        wi = choose(medium, vec3_of(turned.x, turned.y, -turned.z), wi);
        s.weight = choose(medium, vec3_all(1.0f), s.weight);
        s.pdf = medium ? phase_eval(g, turned.z) : s.pdf;
    }
    const vfloat share = bsdf_share(b, through, &sampled);
    s.weight = scale(s.weight, share * inverse_or_one(sampled));
    s.pdf = s.pdf * sampled;
    wi = bsdf_turn_local(b, wi, through);
    s.direction = direction_again(frame_to_world(b->frame, wi));
    // A direction on the other side of the geometry than it is of the shading normal carries no light, but in glass
    const vmask above = inner(s.direction, b->side) > 0.0f;
    const vmask crossed = (above != (wi.z > 0.0f)) & !medium;
    if (lane_any(crossed)) {
        const vmask glass = bsdf_is_clear(b);
        const vec3 scaled = scale(s.weight, bsdf_other_side(b, above, wi.z > 0.0f));
        s.weight = choose(crossed, choose(glass, scaled, vec3_all(0.0f)), s.weight);
    }
    return s;
}

static BsdfSample bsdf_sample(const Bsdf* b, vuint bits_u, vuint bits_v) {
    BsdfSample s = bsdf_sample_one(b, bits_u, bits_v);
#ifdef BSDF_APART
    const vmask apart = b->apart & (s.pdf > 0.0f) & (largest(s.weight) > 0.0f);      // else the direction was lost
    if (lane_any(apart)) {
        vfloat pdf;
        const vec3 f = bsdf_eval_each(b, s.direction, &pdf);
        s.weight = choose(apart, scale(f, inverse_or_one(pdf)), s.weight);
        s.pdf = apart ? pdf : s.pdf;
    }
#endif
    return s;
}

#ifdef INVARIANTS
static vmask bsdf_violates(const Bsdf* b, vmask where) {
    const Frame* f = &b->frame;
    const vmask axes = invariant_unit(f->normal) & invariant_unit(f->tangent) & invariant_unit(f->bitangent);
    const vmask square = invariant_near(inner(f->normal, f->tangent), 0.0f) & invariant_near(inner(f->normal, f->bitangent), 0.0f) &
                         invariant_near(inner(f->tangent, f->bitangent), 0.0f);
    return where & !(axes & square & invariant_unit(b->wo) & (b->wo.z > 0.0f) & invariant_positive3(b->color) & (b->eta > 0.0f));
}
static vmask bsdf_sample_violates(const BsdfSample* s, vmask specular, vmask where) {
    const vmask carries = largest(s->weight) > 0.0f, lengths = !carries | invariant_unit(s->direction);
    return where & !(invariant_positive3(s->weight) & invariant_positive(s->pdf) & lengths & (!specular | (s->pdf == 0.0f)));
}
#endif

#endif
